"""Error counters, flags, bus-off and recovery (RM0090 section 32.7.6, ISO 11898-1 clause 12.1.4)."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.bus.confinement import ErrorCounters
from targets.ecu import Confinement, ErrorCode, SeenError
from targets.mcu.bxcan import node
from targets.mcu.state import CAN_TX_NEW
from tests.targets.mcu.bxcan.registers import (
    ABOM,
    ACK,
    BIT,
    CRC,
    DOMINANT,
    ERRI,
    ESR,
    FORM,
    IER,
    INAK,
    INRQ,
    MCR,
    MSR,
    RECESSIVE,
    RF0R,
    STUFF,
    TSR,
    Can,
)

EWGF, EPVF, BOFF = 1, 2, 4
EWGIE, EPVIE, BOFIE, LECIE, ERRIE = 1 << 8, 1 << 9, 1 << 10, 1 << 11, 1 << 15
STUCK = 1 << 7
MS = 10**6


def bus_off(can):
    """Let it fail with mailbox 0 until it is bus-off: 32 errors of 8."""
    can.fill(0, 0x123)
    for _ in range(32):
        assert not can[ESR] & BOFF
        can.fails(0, tec=8)
    return can


def test_counters_and_last_error_code(can):
    """Errors add to TEC and REC, ESR has them and the last code; a good frame takes one off."""
    for code in (STUFF, FORM, ACK, RECESSIVE, DOMINANT, CRC):
        can.fails(code=code, rec=1)
        assert can.lec == code
    assert (can.tec, can.rec) == (0, 6)
    can.passes()
    assert (can.rec, can.lec) == (5, 0)
    can.fill(0, 0x123)
    can.fails(0, tec=8)
    can.passes(0)
    assert (can.tec, can.rec, can.lec) == (7, 5, 0)


def test_last_error_code_set_by_software(can):
    """Software sets LEC to 7; the next frame or error overwrites it; the counters are read-only."""
    can.fails(rec=1)
    can[ESR] = 0xFFFFFFFF
    assert can[ESR] == 1 << 24 | 7 << 4
    can.passes()
    assert can.lec == 0


def test_warning_and_passive_flags(can):
    """EWGF stands from 96 on, EPVF beyond 127, whichever counter it is, and both fall with it."""
    can.fails(rec=95)
    assert can[ESR] & 7 == 0
    can.fails(rec=1)
    assert can[ESR] & 7 == EWGF
    can.fails(rec=31)
    assert can[ESR] & 7 == EWGF
    can.fails(rec=1)
    assert can[ESR] & 7 == EWGF | EPVF
    can.passes()
    assert can[ESR] & 7 == EWGF
    for _ in range(32):
        can.passes()
    assert can[ESR] & 7 == 0
    can.fill(0, 0x123)
    can.fails(0, tec=128)
    assert can[ESR] & 7 == EWGF | EPVF


def test_receive_counter_after_error_passive(can):
    """From beyond 128 a good reception brings REC to 120; REC stops at 255 and leads to no bus-off."""
    can.fails(rec=200)
    can.fails(rec=200)
    assert can.rec == 255
    assert can[ESR] & BOFF == 0
    can.passes()
    assert can.rec == 120


@pytest.mark.parametrize(
    ("enabled", "tec", "raises"),
    [
        (EWGIE, 95, False),
        (EWGIE, 96, True),
        (EPVIE, 127, False),
        (EPVIE, 128, True),
        (BOFIE, 255, False),
        (BOFIE, 256, True),
        (LECIE, 8, True),
        (0, 256, False),
    ],
)
def test_error_interrupt_needs_its_enable(can, enabled, tec, raises):
    """ERRI is set when an enabled flag rises or, with LECIE, on any error; it calls with ERRIE only."""
    can.fill(0, 0x123)
    can[IER] = enabled
    can.fails(0, tec=tec)
    assert bool(can[MSR] & ERRI) is raises
    assert not can.line(3)
    can[IER] = enabled | ERRIE
    assert can.line(3) is raises
    can[MSR] = ERRI
    assert not can.line(3)


def test_error_interrupt_comes_once_for_a_flag(can):
    """A flag that stays up raises ERRI again only when it has fallen and risen."""
    can[IER] = EWGIE
    can.fails(rec=96)
    can[MSR] = ERRI
    can.fails(rec=1)
    assert not can[MSR] & ERRI
    can.passes()
    can.passes()
    can.fails(rec=1)
    assert can[MSR] & ERRI


def test_confinement_as_the_bus_sees_it(can):
    """Active, passive and off by the counters; off in initialisation; silent in silent mode."""
    assert node.confinement(can.S, can.c) == Confinement.ACTIVE
    can.fails(rec=128)
    assert node.confinement(can.S, can.c) == Confinement.PASSIVE
    bus_off(can)
    assert node.confinement(can.S, can.c) == Confinement.OFF
    fresh = Can().configured(btr=1 << 31 | 1 | 15 << 16 | 4 << 20)
    assert node.confinement(fresh.S, fresh.c) == Confinement.SILENT
    fresh[MCR] = INRQ
    assert node.confinement(fresh.S, fresh.c) == Confinement.OFF


def test_bus_off(can):
    """TEC beyond 255 sets BOFF: nothing is received or sent any more, the mailbox stays pending."""
    bus_off(can)
    assert can[ESR] & 7 == EWGF | EPVF | BOFF
    assert can.tec == 0, "the lower eight of nine bits"
    assert can.offers() == -1
    assert can[TSR] >> 26 & 1 == 0
    can.passes()
    assert can[RF0R] & 3 == 0
    can.t_ns += 10_000 * MS
    assert can[ESR] & BOFF


def test_automatic_recovery_from_bus_off():
    """With ABOM bus-off ends 128 times 11 recessive bits after the error frame, and the mailbox is sent."""
    can = bus_off(Can().configured(mcr=ABOM))
    free = can.t_ns  # end of the error frame, the last 8 bits of which were recessive
    can.S[CAN_TX_NEW] = 0
    end = free + (128 * 11 - 8) * BIT
    can.t_ns = end - 50
    assert can[ESR] & BOFF
    can.t_ns = end
    assert can[ESR] & ~(7 << 4) == 0
    assert can.offers() == 0
    assert can.S[CAN_TX_NEW] == 1


def test_frames_interrupt_the_recovery():
    """Each frame ends a run of recessive bits: what was short of 11 counts for nothing."""
    can = bus_off(Can().configured(mcr=ABOM))
    can.t_ns += 3 * BIT  # 11 recessive bits: the first sequence
    for _ in range(126):
        can.starts()
        can.t_ns += 100 * BIT
        can.arrives(0x100)
        can.t_ns += 3 * BIT  # one sequence each
    can.starts()
    can.t_ns += 100 * BIT
    can.arrives(0x100)
    can.t_ns += 2 * BIT
    assert can[ESR] & BOFF
    can.t_ns += 1 * BIT
    assert not can[ESR] & BOFF


def test_software_starts_the_recovery(can):
    """Without ABOM recovery takes INRQ set and cleared, then 128 times 11 recessive bits."""
    bus_off(can)
    can[MCR] = INRQ
    assert can[MSR] & INAK
    can.t_ns += 100 * MS
    assert can[ESR] & BOFF, "in initialisation mode the bus is not watched"
    can[MCR] = 0
    begun = can.t_ns
    can.t_ns = begun + 11 * BIT
    assert not can[MSR] & INAK
    can.t_ns = begun + 128 * 11 * BIT - 50
    assert can[ESR] & BOFF
    can.t_ns = begun + 128 * 11 * BIT
    assert not can[ESR] & BOFF
    assert can.offers() == 0


def test_recovery_switched_on_in_bus_off(can):
    """ABOM set while bus-off starts the recovery."""
    bus_off(can)
    can.t_ns += 100 * MS
    can[MCR] = ABOM
    can.t_ns += 128 * 11 * BIT
    assert not can[ESR] & BOFF


def test_sender_stuck_in_bus_off(can):
    """A request made in bus-off without ABOM is reported after 100 ms; one made before is not."""
    bus_off(can)
    can.S[CAN_TX_NEW] = 0
    can.t_ns += 200 * MS
    assert can.S[CAN_TX_NEW] == 0
    can.fill(1, 0x124)
    begun = can.t_ns
    can.t_ns = begun + 100 * MS - 50
    assert can.S[CAN_TX_NEW] == 0
    can.t_ns = begun + 100 * MS
    assert can.S[CAN_TX_NEW] == STUCK


@pytest.mark.parametrize("way_out", ["abort", "initialise", "abom"])
def test_sender_that_leaves_bus_off_is_not_stuck(can, way_out):
    """A request taken back, or a recovery under way, is no fault."""
    bus_off(can)
    can.S[CAN_TX_NEW] = 0
    can.fill(1, 0x124)
    can.t_ns += 50 * MS
    if way_out == "abort":
        can[TSR] = 0x80 << 8
    elif way_out == "initialise":
        can[MCR] = INRQ
    else:
        can[MCR] = ABOM
    can.t_ns += 100 * MS
    assert can.S[CAN_TX_NEW] & STUCK == 0


steps = st.one_of(
    st.tuples(st.just("sent"), st.just(0), st.just(0)),
    st.tuples(st.just("received"), st.just(0), st.just(0)),
    st.tuples(st.just("tx error"), st.sampled_from((0, 8)), st.just(0)),
    st.tuples(st.just("rx error"), st.just(0), st.sampled_from((1, 8))),
    st.tuples(st.just("idle"), st.integers(0, 200), st.just(0)),
)


@given(st.lists(steps, max_size=120), st.integers(0, 31))
def test_same_counters_as_a_plain_node(sequence, head_start):
    """Over any course of events bxCAN's counters and state are those of the bus's own nodes."""
    can, plain = Can().configured(mcr=ABOM), ErrorCounters()
    quiet = 10**9  # bits the bus has been recessive
    for kind, tec, rec in [("tx error", 8, 0)] * head_start + sequence:
        off = plain.confinement is Confinement.OFF
        if kind == "idle":
            can.t_ns += tec * 11 * BIT
            quiet += tec * 11
            if off and quiet >= 11 * plain.left:
                plain.recessive(quiet)
                quiet = 0
        else:
            if off:
                plain.recessive(quiet)
            if kind in ("sent", "tx error") and not off and can[TSR] >> 26 & 1:
                can.fill(0, 0x123)
            mailbox = 0 if kind in ("sent", "tx error") and not off else None
            if kind in ("sent", "received"):
                can.passes(mailbox)
                if not off:
                    plain.transmitted() if mailbox == 0 else plain.received()
            else:
                can.fails(mailbox, FORM, *((tec, rec) if mailbox == 0 or kind == "rx error" else (0, 0)))
                if not off:
                    plain.error(SeenError(ErrorCode.FORM, tec, rec))
            can.t_ns += 3 * BIT
            quiet = 11
            if plain.left and off and quiet >= 11 * plain.left:
                plain.recessive(quiet)
                quiet = 0
        counters = (can.tec, can.rec, bool(can[ESR] & BOFF))
        assert counters == (plain.tec & 0xFF, plain.rec, plain.left > 0)

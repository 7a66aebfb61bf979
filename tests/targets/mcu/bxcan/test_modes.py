"""Operating modes and synchronisation (RM0090 section 32.4)."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from targets.mcu.state import CAN_LOST, CAN_TX_NEW, HZ
from tests.targets.mcu.bxcan.registers import (
    ABOM,
    AWUM,
    BIT,
    BTR,
    BTR_500K,
    FA1R,
    IER,
    INAK,
    INRQ,
    MCR,
    MSR,
    NART,
    RF0R,
    SLAK,
    SLAKI,
    SLEEP,
    TIR,
    TSR,
    WKUI,
    Can,
)

MODE = INAK | SLAK
TXM, RXM = 1 << 8, 1 << 9
WKUIE, SLKIE = 1 << 16, 1 << 17


def leave_initialisation(can):
    can[MCR] = INRQ
    can[BTR] = BTR_500K
    can[MCR] = 0


def test_reset_is_sleep(reset):
    """After reset the controller sleeps, with the manual's reset values."""
    assert reset[MCR] == 0x00010002
    assert reset[MSR] == 0x00000C02
    assert reset[TSR] == 0x1C000000
    assert reset[BTR] == 0x01230000


def test_sleep_ignores_an_initialisation_request(reset):
    """INRQ alone does not end sleep; with SLEEP cleared initialisation is entered at once."""
    reset[MCR] = INRQ | SLEEP
    assert reset[MSR] & MODE == SLAK
    reset[MCR] = INRQ
    assert reset[MSR] & MODE == INAK


def test_initialisation_is_entered_at_once_on_an_idle_bus(can):
    """INRQ on an idle bus is acknowledged by INAK."""
    can[MCR] = INRQ
    assert can[MSR] & MODE == INAK


@pytest.mark.parametrize("mailbox", [None, 1], ids=["reception", "transmission"])
def test_initialisation_waits_for_the_frame_under_way(can, mailbox):
    """INRQ during a frame is acknowledged when it has ended, and the frame is completed."""
    if mailbox is not None:
        can.fill(mailbox, 0x123)
    can.starts(mailbox)
    can[MCR] = INRQ
    assert can[MSR] & MODE == 0
    if mailbox is None:
        can.arrives(0x100)
        assert can[RF0R] & 3 == 1
    else:
        can.is_sent(mailbox)
        assert can[TSR] & 0x300 == 0x300
    assert can[MSR] & MODE == INAK


def test_initialisation_waits_for_the_end_of_an_error_frame(can):
    """A frame that fails holds INAK back until its error frame is over."""
    can.starts()
    can[MCR] = INRQ
    can.errs(rec=1)
    assert can[MSR] & MODE == 0
    can.is_free()
    assert can[MSR] & MODE == INAK


def test_withdrawn_initialisation_request(can):
    """INRQ cleared again before it was acknowledged leaves normal mode as it was."""
    can.starts()
    can[MCR] = INRQ
    can[MCR] = 0
    can.arrives(0x100)
    assert can[MSR] & MODE == 0


@given(
    st.integers(0, 1023),
    st.integers(0, 15),
    st.integers(0, 7),
    st.sampled_from((16_000_000, 22_000_000, 168_000_000)),
)
def test_leaving_initialisation_takes_eleven_recessive_bits(brp, ts1, ts2, hz):
    """INAK clears when 11 bits of the configured length have passed on an idle bus, to the cycle."""
    can = Can()
    can.S[HZ] = hz
    can[MCR] = INRQ
    can[BTR] = brp | ts1 << 16 | ts2 << 20
    begun = int(can.S[16])
    can[MCR] = 0
    cycles = 11 * (brp + 1) * (3 + ts1 + ts2)
    can.S[16] = begun + cycles - 1
    assert can[MSR] & INAK
    can.S[16] = begun + cycles
    assert not can[MSR] & INAK


def test_leaving_initialisation_on_a_busy_bus(reset):
    """No sequence is complete within a frame; its ACK delimiter and end of frame count for 8 bits."""
    reset.starts()
    leave_initialisation(reset)
    reset.t_ns = 200 * BIT
    assert reset[MSR] & INAK
    reset.arrives(0x100)
    reset.t_ns = 203 * BIT - 50
    assert reset[MSR] & INAK
    reset.t_ns = 203 * BIT
    assert not reset[MSR] & INAK
    assert reset.S[CAN_LOST] == 1, "it was not on the bus when the frame began"


def test_recessive_bits_before_a_frame_do_not_count(reset):
    """Ten recessive bits, a frame, and the count begins anew behind it."""
    leave_initialisation(reset)
    reset.t_ns = 10 * BIT
    reset.starts()
    reset.t_ns = 60 * BIT
    assert reset[MSR] & INAK
    reset.arrives(0x100)
    reset.t_ns = 63 * BIT - 50
    assert reset[MSR] & INAK
    reset.t_ns = 63 * BIT
    assert not reset[MSR] & INAK


def test_back_to_back_frames_are_enough_to_synchronise(reset):
    """On a saturated bus the 11 recessive bits between frames are enough, also to a bit 0.3 % too long."""
    reset.S[HZ] = 22_000_000 * 997 // 1000
    reset.starts()
    leave_initialisation(reset)
    reset.arrives(0x100, t_ns=100 * BIT)
    reset.starts(t_ns=103 * BIT)
    assert not reset[MSR] & INAK


def test_sleep_is_entered_after_the_frame_under_way(can):
    """SLEEP is acknowledged when the frame has ended; SLAKI tells of it only with SLKIE."""
    can.starts()
    can[MCR] = SLEEP
    assert can[MSR] & MODE == 0
    can.arrives(0x100)
    assert can[MSR] & (MODE | SLAKI) == SLAK


def test_sleep_acknowledge_interrupt(can):
    """With SLKIE entering sleep sets SLAKI, which software clears by a one, or waking up by itself."""
    can[IER] = SLKIE
    can[MCR] = SLEEP
    assert can[MSR] & SLAKI
    assert can.line(3)
    can[MSR] = SLAKI
    assert not can[MSR] & SLAKI
    can[MCR] = 0
    can.t_ns += 11 * BIT
    can[MCR] = SLEEP
    can[MCR] = 0
    assert can[MSR] & (SLAK | SLAKI) == SLAK | SLAKI
    can.t_ns += 11 * BIT
    assert can[MSR] & (SLAK | SLAKI) == 0


def test_software_ends_sleep_after_eleven_recessive_bits(can):
    """SLEEP cleared: SLAK clears once the bus was recessive for 11 bits."""
    can[MCR] = SLEEP
    can.t_ns += 10**6
    begun = can.t_ns
    can[MCR] = 0
    can.t_ns = begun + 11 * BIT - 100
    assert can[MSR] & SLAK
    can.t_ns = begun + 11 * BIT
    assert not can[MSR] & SLAK


@pytest.mark.parametrize("awum", [0, AWUM])
def test_start_of_frame_wakes(can, awum):
    """A frame sets WKUI in sleep, with AWUM it clears SLEEP; it is missed itself, the next one is not."""
    can[IER] = WKUIE
    can[MCR] = SLEEP | awum
    can.starts()
    assert can[MSR] & WKUI
    assert can.line(3)
    assert bool(can[MCR] & SLEEP) is not bool(awum)
    can.t_ns += 100 * BIT
    can.arrives(0x100)
    can.t_ns += 3 * BIT
    assert bool(can[MSR] & SLAK) is not bool(awum)
    assert can[RF0R] & 3 == 0
    can.passes()
    assert can[RF0R] & 3 == (1 if awum else 0)


def test_initialisation_from_initialisation_to_sleep(can):
    """From initialisation mode SLEEP without INRQ leads to sleep at once."""
    can[MCR] = INRQ
    can[MCR] = SLEEP
    assert can[MSR] & MODE == SLAK


def test_bit_timing_is_locked_in_normal_mode(can):
    """BTR takes writes in initialisation mode only, and no reserved bits."""
    can[BTR] = 7
    assert can[BTR] == BTR_500K
    can[MCR] = INRQ
    can[BTR] = 0xFFFFFFFF
    assert can[BTR] == 0xC37F03FF


def test_request_in_initialisation_waits_for_normal_mode(can):
    """A mailbox requested in initialisation mode stays pending, and is offered to the bus afterwards."""
    can[MCR] = INRQ
    can.fill(0, 0x123)
    assert can.offers() == -1
    assert can.S[CAN_TX_NEW] == 0
    assert can[TSR] >> 26 & 1 == 0
    can[MCR] = 0
    can.t_ns += 11 * BIT
    assert can.offers() == 0
    assert can.S[CAN_TX_NEW] == 1


def test_nothing_is_received_in_initialisation(can):
    """In initialisation mode no message comes in."""
    can[MCR] = INRQ
    can.passes()
    assert can[RF0R] & 3 == 0
    assert can.S[CAN_LOST] == 1


def test_master_reset(can):
    """RESET puts the controller to sleep and empties FIFOs and mailboxes; bit timing and filters stay."""
    can.passes()
    can.fill(0, 0x123)
    can.fails(tec=8, rec=1)
    can[MCR] = 1 << 15
    assert can[MCR] == 0x00010002
    assert can[MSR] & MODE == SLAK
    assert (can[RF0R], can[TSR], can[TIR] & 1, can.tec, can.rec) == (0, 0x1C000000, 0, 0, 0)
    assert (can[BTR], can[FA1R]) == (BTR_500K, 1)


def test_status_says_who_sends(can):
    """TXM while its own frame is on the bus, RXM while another's is, neither on an idle bus."""
    assert can[MSR] & (TXM | RXM) == 0
    can.starts()
    assert can[MSR] & (TXM | RXM) == RXM
    can.arrives(0x100)
    can.fill(2, 0x123)
    can.starts(2)
    assert can[MSR] & (TXM | RXM) == TXM
    can.is_sent(2)
    assert can[MSR] & (TXM | RXM) == 0


def test_control_register_keeps_its_bits_only(can):
    """MCR reads back what it has, DBF among it, and nothing of the reserved bits."""
    can[MCR] = 0xFFFF7F00 | ABOM | NART
    assert can[MCR] == 0x00010000 | ABOM | NART


def test_unknown_register_is_not_modelled(can):
    """A register that does not exist says so instead of taking the access."""
    from targets.mcu import bxcan

    for offset in (0x20, 0x1D0, 0x208, 0x3F0, 0x600, 0x640):
        assert bxcan.read(can.S, offset) == -1
        assert not bxcan.write(can.S, offset, 1)

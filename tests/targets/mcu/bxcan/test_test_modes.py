"""Silent and loop-back mode (RM0090 section 32.5)."""

import pytest

from bench.bus.bits import frame_bits
from targets.mcu.state import CAN_TX_NEW
from tests.targets.mcu.bxcan.registers import (
    BIT,
    BTR_500K,
    ESR,
    IER,
    INAK,
    INRQ,
    MCR,
    MSR,
    RDHR,
    RDLR,
    RDTR,
    RF0R,
    RIR,
    TSR,
    TTCM,
    Can,
    rir,
)

SILM, LBKM = 1 << 31, 1 << 30
DATA = b"\x01\x23\x45\x67\x89\xab\xcd\xef"


@pytest.fixture(params=[LBKM, LBKM | SILM], ids=["loop-back", "combined"])
def looped(request):
    return Can().configured(btr=BTR_500K | request.param).open_filter()


def test_loop_back_returns_its_own_frames(looped):
    """A frame sent in loop-back mode is received after its length in bits, and nothing asks for the bus."""
    begun = looped.t_ns
    looped.fill(0, 0x123, DATA)
    bits = frame_bits(0x123, DATA)
    looped.t_ns = begun + bits * BIT - 50
    assert looped[RF0R] & 3 == 0
    assert looped[TSR] & 3 == 0
    looped.t_ns = begun + bits * BIT
    assert looped[TSR] & 3 == 3
    assert looped[RF0R] & 3 == 1
    assert looped[RIR] == rir(0x123)
    assert looped[RDTR] & 0xF == 8
    assert looped[RDLR].to_bytes(4, "little") + looped[RDHR].to_bytes(4, "little") == DATA
    assert looped.S[CAN_TX_NEW] == 0
    assert looped.offers() == -1


def test_loop_back_passes_the_filters(looped):
    """What no filter lets in does not come back, but counts as sent."""
    looped[0x200] = 14 << 8 | 1
    looped[0x21C] = 0
    looped[0x200] = 14 << 8
    looped.fill(0, 0x123)
    looped.t_ns += 10**6
    assert looped[TSR] & 3 == 3
    assert looped[RF0R] & 3 == 0


def test_loop_back_sends_by_priority_with_intermission(looped):
    """Frames follow one another after three bits, the lowest identifier first of those that wait."""
    begun = looped.t_ns
    for mailbox, identifier in ((0, 0x300), (1, 0x200), (2, 0x100)):
        looped.fill(mailbox, identifier)
    bits = [frame_bits(identifier, b"") for identifier in (0x300, 0x100, 0x200)]
    looped.t_ns = begun + (sum(bits) + 6) * BIT - 50
    assert looped[RF0R] & 3 == 2
    looped.t_ns = begun + (sum(bits) + 6) * BIT
    assert looped[RF0R] & 3 == 3
    order = []
    while looped[RF0R] & 3:
        order.append(looped[RIR] >> 21)
        looped[RF0R] = 0x20
    assert order == [0x300, 0x100, 0x200]


@pytest.mark.parametrize(("extended", "remote"), [(False, True), (True, False), (True, True)])
def test_loop_back_of_other_frames(looped, extended, remote):
    """Extended and remote frames come back as such, a remote one without taking time for data."""
    begun = looped.t_ns
    looped.fill(1, 0x155, b"" if not remote else bytes(8), extended, remote)
    stuffless = frame_bits(0x155, b"", extended)
    looped.t_ns = begun + (stuffless + 8) * BIT
    assert looped[RF0R] & 3 == 1
    assert looped[RIR] == rir(0x155, extended, remote)
    assert looped[RDTR] & 0xF == (8 if remote else 0)


def test_loop_back_does_not_hear_the_bus(looped):
    """Frames of the bus are not received in loop-back mode, and do not disturb."""
    looped.fill(0, 0x123)
    looped.passes()
    assert looped[RF0R] & 3 == 1
    assert looped[RIR] >> 21 == 0x123
    assert looped[ESR] == 0


def test_initialisation_waits_for_the_looped_frame(looped):
    """INRQ during a looped frame is acknowledged at its end; what else waits is sent after the return."""
    begun = looped.t_ns
    looped.fill(0, 0x123)
    looped.fill(1, 0x124)
    looped[MCR] = INRQ
    assert not looped[MSR] & INAK
    looped.t_ns = begun + frame_bits(0x123, b"") * BIT
    assert looped[MSR] & INAK
    looped.t_ns += 10**6
    assert looped[RF0R] & 3 == 1
    looped[MCR] = 0
    looped.t_ns += 10**6
    assert looped[RF0R] & 3 == 2


def test_time_stamps_in_loop_back():
    """The stamp of the start of frame is in both mailboxes, and with TGT in the data that come back."""
    can = Can().configured(btr=BTR_500K | LBKM, mcr=TTCM).open_filter()
    can.t_ns = 11 * BIT + 0x1234 * BIT
    can.fill(0, 0x123, DATA, more=1 << 8)
    can.t_ns += 10**6
    assert can[RDTR] >> 16 == can[0x184] >> 16 == 0x1234
    assert can[RDHR].to_bytes(4, "little") == DATA[4:6] + b"\x12\x34"


def test_interrupts_in_loop_back(looped):
    """The looped frame calls for both interrupts: transmission done, message pending."""
    looped[IER] = 3
    looped.fill(0, 0x123)
    assert not looped.line(0)
    assert not looped.line(1)
    looped.t_ns += 10**6
    assert looped.line(0)
    assert looped.line(1)


def test_silent_mode_hears_and_does_not_send():
    """In silent mode frames are received, requests stay pending."""
    can = Can().configured(btr=BTR_500K | SILM).open_filter()
    can.fill(0, 0x123)
    assert can.offers() == -1
    assert can.S[CAN_TX_NEW] == 0
    can.passes()
    assert can[RF0R] & 3 == 1
    assert can[TSR] >> 26 & 1 == 0

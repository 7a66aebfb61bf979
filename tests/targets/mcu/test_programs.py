"""Firmwares that are not this project's: other start-up and layout, unoptimised, with a C library."""

from itertools import pairwise

import pytest

from targets.emulated import EmulatedEcu
from targets.mcu import state
from targets.mcu.image import load
from targets.mcu.machine import Stm32f405
from tests.targets.mcu.programs import built

MS = 1_000_000
LIBRARY = ("-Os", "--specs=nano.specs", "--specs=nosys.specs")

pytestmark = pytest.mark.usefixtures("arm_gcc")


@pytest.mark.parametrize(
    ("at", "data_at"),
    [(0x08000000, 0x20000000), (0x08008000, 0x20000000), (0x00000000, 0x20000000), (0x20000000, 0x20010000)],
    ids=["flash", "behind-a-boot-loader", "alias-of-flash", "sram"],
)
def test_program_with_a_c_library(at, data_at):
    """A program with newlib, heap and constructor computes what it is to, wherever it was linked to."""
    image = load(built("words", *LIBRARY, code_at=at, data_at=data_at), vectors=at)
    mcu = Stm32f405(image)
    mcu.run(10 * MS)
    said = mcu.read_bytes(image.symbol("said"), 64).split(b"\0")[0]
    assert said == b"alpha zeta 7 my -41446"
    assert mcu.state[state.SLEEPING] == 1
    assert "in main (words.c:" in mcu.where()
    assert mcu.unmodelled() == {}


@pytest.mark.parametrize("level", ["-O0", "-O2", "-Os"])
def test_heartbeat_on_can(level):
    """At 168 MHz, with its stack in CCM and a function in SRAM, it sends a frame each 10 ms."""
    image = load(built("heart", level, "-DBRP=6", stack=0x10010000))
    ecu = EmulatedEcu(image, None, "heart", power_on_ns=0)
    sent = []
    while (request := ecu.advance(95 * MS)) is not None:
        sent.append(request)
        ecu.sent(request.handle, request.t_ns)
    assert [request.frame.id for request in sent[:5]] == [0x123, 0x123, 0x123, 0x1234567, 0x123]
    assert [request.frame.extended for request in sent[:5]] == [False, False, False, True, False]
    assert [request.frame.data for request in sent[:2]] == [b"\x40\xa5", b"\x41\xa5"]
    assert len(sent) == 10
    assert all(abs(b.t_ns - a.t_ns - 10 * MS) < 10_000 for a, b in pairwise(sent))
    assert ecu.mcu.hz == 168_000_000
    assert ecu.mcu.unmodelled() == {0x40013000: 1, 0x40013008: 2}
    assert image.function_at(ecu.mcu.pc).startswith("wait_cycles")
    assert 0x20000000 <= ecu.mcu.pc < 0x20000100

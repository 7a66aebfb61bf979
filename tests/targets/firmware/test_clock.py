"""Clock settings: register words that give the frequency asked for, within every limit."""

import struct

import pytest

from targets.ecus import build
from targets.emulated import EmulatedEcu
from targets.errors import FirmwareError, TargetError
from targets.firmware import ELF, STEP_ELF
from targets.firmware.clock import SYMBOL, setting, settings
from targets.mcu.image import FLASH, load

AHB = {0: 1, 8: 2, 9: 4, 10: 8, 11: 16, 12: 64, 13: 128, 14: 256, 15: 512}
APB = {0: 1, 4: 2, 5: 4, 6: 8, 7: 16}


@pytest.mark.parametrize("one", list(settings()), ids=lambda one: f"{one.hz / 1e6:g}")
def test_registers_give_the_clock(one):
    """Read back as the reference manual defines the registers, every setting is its clock, within limits."""
    m, n = one.pllcfgr & 0x3F, one.pllcfgr >> 6 & 0x1FF
    p = 2 * (one.pllcfgr >> 16 & 3) + 2
    vco = 8_000_000 / m * n
    assert 192e6 <= vco <= 432e6
    assert 24e6 <= vco / p <= 168e6
    assert one.pllcfgr >> 22 & 1 == 1
    assert one.cfgr & 3 == 2
    hclk = vco / p / AHB[one.cfgr >> 4 & 15]
    assert hclk == one.hz
    apb1, apb2 = hclk / APB[one.cfgr >> 10 & 7], hclk / APB[one.cfgr >> 13 & 7]
    assert apb1 <= 42e6
    assert apb2 <= 84e6
    assert (one.acr & 7) * 30e6 < hclk <= ((one.acr & 7) + 1) * 30e6
    quanta = 3 + (one.btr >> 16 & 15) + (one.btr >> 20 & 7)
    assert 8 <= quanta <= 25
    assert apb1 / (((one.btr & 0x3FF) + 1) * quanta) == 500_000
    assert 0.65 <= (2 + (one.btr >> 16 & 15)) / quanta <= 0.9


def test_the_tables_clocks_can_be_set():
    """22, 84 and 168 MHz are among the settings, with 0, 2 and 5 wait states; the first is 4 MHz."""
    assert [setting(hz).acr & 7 for hz in (22_000_000, 84_000_000, 168_000_000)] == [0, 2, 5]
    assert next(settings()).hz == 4_000_000
    assert next(settings(21_000_001)).hz == 22_000_000


@pytest.mark.parametrize(
    ("hz", "says"),
    [
        (23_100_000, "clock 23.1 MHz: no setting of the PLL"),
        (0, "clock 0 MHz: no setting of the PLL"),
        (180_000_000, "clock 180 MHz: no setting of the PLL"),
        (3_500_000, r"clock 3.5 MHz: 3.5 MHz on APB1 cannot be divided into CAN bits of 500000 bit/s"),
    ],
)
def test_clock_that_cannot_be_set(hz, says):
    """A clock outside the PLL's or the bus's reach is refused with its value."""
    with pytest.raises(TargetError, match=says):
        setting(hz)


@pytest.mark.parametrize("path", [*ELF.values(), *STEP_ELF.values()], ids=lambda path: path.stem)
def test_images_hold_the_setting_for_22_mhz(path):
    """The words in the board's source are what the table of settings gives for the thesis's 22 MHz."""
    image = load(path)
    at = image.symbol(SYMBOL) - FLASH
    assert image.flash[at : at + 16] == setting(22_000_000).content()
    assert struct.unpack("<4I", setting(22_000_000).content())[0] == setting(22_000_000).pllcfgr


@pytest.mark.parametrize("mhz", [4, 22, 84, 168])
def test_firmware_runs_at_the_clock(mhz):
    """The unmodified program boots at the clock written over its setting, on a bus of 500 kbit/s."""
    from targets.mcu.bxcan import timing

    ecu = build(clock_hz=mhz * 1_000_000).power_on()
    assert ecu.advance(0) is None
    assert ecu.mcu.hz == mhz * 1_000_000
    assert timing.bitrate(ecu.mcu.state, 0) == 500_000
    assert ecu.mcu.unmodelled() == {}


def test_clock_is_part_of_what_identifies_a_build():
    """A build at another clock than its image's says so; the host has no clock."""
    assert "clock_hz" not in build().provenance()
    assert build(clock_hz=6_000_000).provenance()["clock_hz"] == "6000000"
    with pytest.raises(TargetError, match="clock 6 MHz: the host has no clock"):
        build(host="host", clock_hz=6_000_000)


def test_image_without_a_setting(calibration):
    """A firmware that keeps its clock to itself cannot be given another one."""
    from dataclasses import replace

    image = load(ELF["ifd"])
    symbols = {name: at for name, at in image.symbols.items() if name != SYMBOL}
    with pytest.raises(FirmwareError, match="no symbol clock_setting"):
        EmulatedEcu(replace(image, symbols=symbols), calibration, clock_hz=6_000_000)

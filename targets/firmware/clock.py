"""The clock a firmware runs at: register words for any frequency that its board and its bus allow.

The image holds one such setting, `clock_setting` of stm32f405/board.c, which `EmulatedEcu` can overwrite as a
flash tool would. Belongs here: choosing PLL, prescalers, wait states and the CAN bit. Never: an emulator.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from targets.errors import TargetError

SYMBOL = "clock_setting"
CRYSTAL_HZ = 8_000_000
BITRATE = 500_000
HIGHEST_HZ, HIGHEST_APB1_HZ, HIGHEST_APB2_HZ = 168_000_000, 42_000_000, 84_000_000  # RM0090 section 7.2
STEP_HZ = 500_000
"""Clocks are tried in these steps: CAN needs a whole number of cycles a bit."""

_PLLM = 8  # 1 MHz into the PLL
_VCO_HZ = (192_000_000, 432_000_000)  # DS8626 table 36; the reference manual begins at 100 MHz
_PLL_HZ = (24_000_000, HIGHEST_HZ)
_PLLQ = 9  # 48 MHz or less for what is not used
_AHB = {1: 0, 2: 8, 4: 9, 8: 10, 16: 11, 64: 12, 128: 13, 256: 14, 512: 15}
_APB = {1: 0, 2: 4, 4: 5, 8: 6, 16: 7}
_HZ_A_WAIT_STATE = 30_000_000  # at 2.7 to 3.6 V, RM0090 table 10
_PREFETCH, _CACHES = 1 << 8, 3 << 9
_QUANTA = (8, 25)  # of a CAN bit, RM0090 section 32.7.7
_SAMPLE = 0.8


@dataclass(frozen=True)
class Setting:
    """What the board writes at start: RCC_PLLCFGR, RCC_CFGR, FLASH_ACR and CAN_BTR, for a CPU at `hz`."""

    hz: int
    pllcfgr: int
    cfgr: int
    acr: int
    btr: int

    def content(self) -> bytes:
        """The bytes of `clock_setting` in flash."""
        return struct.pack("<4I", self.pllcfgr, self.cfgr, self.acr, self.btr)


def setting(hz: int, bitrate: int = BITRATE) -> Setting:
    """The registers for a CPU at `hz` on a bus of `bitrate` bit/s; TargetError if there are none."""
    found = _pll(hz)
    if found is None:
        raise TargetError(
            f"clock {hz / 1e6:g} MHz: no setting of the PLL gives it; it gives whole divisors of "
            f"24 to 168 MHz, e.g. 4, 22, 84 and 168 MHz"
        )
    n, p, ahb = found
    apb1 = next(d for d in _APB if hz <= d * HIGHEST_APB1_HZ)
    apb2 = next(d for d in _APB if hz <= d * HIGHEST_APB2_HZ)
    waits = (hz - 1) // _HZ_A_WAIT_STATE
    return Setting(
        hz,
        # PLLSRC: the crystal (section 7.3.2)
        _PLLM | n << 6 | (p // 2 - 1) << 16 | 1 << 22 | _PLLQ << 24,
        # SW: the PLL (section 7.3.3)
        2 | _AHB[ahb] << 4 | _APB[apb1] << 10 | _APB[apb2] << 13,
        # With the caches on, code and data do not wait for each other, with or without wait states.
        waits | _CACHES | (_PREFETCH if waits else 0),
        _bit(hz // apb1, bitrate, hz),
    )


def settings(from_hz: int = 0) -> Iterator[Setting]:
    """Every clock that can be set, upwards from `from_hz`, in steps of STEP_HZ."""
    for hz in range(max(STEP_HZ, -(-from_hz // STEP_HZ) * STEP_HZ), HIGHEST_HZ + 1, STEP_HZ):
        try:
            yield setting(hz)
        except TargetError:
            continue


def _pll(hz: int) -> tuple[int, int, int] | None:
    """PLLN, PLLP and the AHB divisor, the least of each that will do; None if nothing gives `hz`."""
    for ahb in _AHB:
        for p in (2, 4, 6, 8):
            vco = hz * ahb * p
            if (
                vco % (CRYSTAL_HZ // _PLLM) == 0
                and _VCO_HZ[0] <= vco <= _VCO_HZ[1]
                and _PLL_HZ[0] <= hz * ahb <= _PLL_HZ[1]
            ):
                return vco // (CRYSTAL_HZ // _PLLM), p, ahb
    return None


def _bit(apb1_hz: int, bitrate: int, hz: int) -> int:
    """CAN_BTR: the most quanta a bit, sampled near 80 % (section 32.9.2)."""
    for quanta in range(_QUANTA[1], _QUANTA[0] - 1, -1):
        prescaler, rest = divmod(apb1_hz, bitrate * quanta)
        if rest == 0 and 1 <= prescaler <= 1024:
            first = min(16, round(_SAMPLE * quanta) - 1)
            return prescaler - 1 | (first - 1) << 16 | (quanta - first - 2) << 20
    raise TargetError(
        f"clock {hz / 1e6:g} MHz: {apb1_hz / 1e6:g} MHz on APB1 cannot be divided into CAN bits of "
        f"{bitrate} bit/s with {_QUANTA[0]} to {_QUANTA[1]} quanta"
    )

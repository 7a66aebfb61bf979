"""What the firmware sets beyond the data sheet's limits: counted, with the last offending value.

Silicon may fail there or may not, so the emulator goes on and says so. Limits for a supply of 2.7 to 3.6 V.
"""

from targets.jit import njit
from targets.mcu.state import FLASH_ACR, PWR_CR, RCC_PLLCFGR, RCC_WARNINGS, State

PLL_INPUT, PLL_VCO, PLL_FACTOR, PLL_LOCKED, HCLK, PCLK1, PCLK2, LATENCY = range(8)
_TEXTS = (
    "the PLL's input of {} Hz is outside 1 to 2 MHz (RM0090 section 7.3.2)",
    "the PLL's VCO at {} Hz is outside 100 to 432 MHz (RM0090 section 7.3.2)",
    "PLLCFGR {:#010x} holds a factor that is not allowed: the PLL does not lock (RM0090 section 7.3.2)",
    "PLLCFGR written ({:#010x}) while the PLL is on: ignored (RM0090 section 7.3.2)",
    "HCLK of {} Hz is above the limit of the voltage scale (RM0090 section 5.4.1)",
    "PCLK1 of {} Hz is above 42 MHz (RM0090 section 7.2)",
    "PCLK2 of {} Hz is above 84 MHz (RM0090 section 7.2)",
    "the flash latency is too short for HCLK of {} Hz (RM0090 table 10)",
)


@njit("void(int64[::1], int64, int64)", cache=True)
def warn(S: State, kind: int, value: int) -> None:
    """One more of a kind."""
    S[RCC_WARNINGS + 2 * kind] += 1
    S[RCC_WARNINGS + 2 * kind + 1] = value


@njit(cache=True)
def check_pll(S: State, source_hz: int) -> bool:
    """Look at the PLL as it is switched on; False if it cannot lock."""
    pll = S[RCC_PLLCFGR]
    m, n = pll & 0x3F, pll >> 6 & 0x1FF
    if m < 2 or n < 50 or n > 432:
        warn(S, PLL_FACTOR, pll)
        return False
    if not 1_000_000 * m <= source_hz <= 2_000_000 * m:
        warn(S, PLL_INPUT, source_hz // m)
    vco = source_hz * n // m
    if not 100_000_000 <= vco <= 432_000_000:
        warn(S, PLL_VCO, vco)
    return True


@njit(cache=True)
def check(S: State, hclk: int, pclk1: int, pclk2: int) -> None:
    """Look at the buses' clocks and the flash after one of them has changed."""
    if hclk > (168_000_000 if S[PWR_CR] >> 14 & 1 else 144_000_000):
        warn(S, HCLK, hclk)
    if pclk1 > 42_000_000:
        warn(S, PCLK1, pclk1)
    if pclk2 > 84_000_000:
        warn(S, PCLK2, pclk2)
    if hclk > 30_000_000 * ((S[FLASH_ACR] & 7) + 1):
        warn(S, LATENCY, hclk)


def warnings(S: State) -> dict[str, int]:
    """What was beyond a limit, in words with the last value, and how often it was set so."""
    pairs = [(int(S[RCC_WARNINGS + 2 * k]), int(S[RCC_WARNINGS + 2 * k + 1])) for k in range(len(_TEXTS))]
    return {text.format(value): times for text, (times, value) in zip(_TEXTS, pairs, strict=True) if times}

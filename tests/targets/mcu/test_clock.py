"""The clock tree, and cycles as time."""

import pytest

from targets.mcu import clock, rcc
from targets.mcu.state import BASE_NS, CYCLES, HZ, allocate

CR, PLLCFGR, CFGR = 0x00, 0x04, 0x08


@pytest.fixture
def S():
    S = allocate()
    S[HZ] = rcc.HSI_HZ
    rcc.reset(S)
    return S


def test_starts_on_the_internal_oscillator(S):
    """After reset the CPU runs at 16 MHz."""
    assert rcc.frequency(S) == 16_000_000


@pytest.mark.parametrize(
    ("m", "n", "p", "hz"), [(8, 176, 3, 22_000_000), (8, 336, 1, 84_000_000), (8, 336, 0, 168_000_000)]
)
def test_pll_sets_the_frequency(S, m, n, p, hz):
    """HSE / M * N / P is the CPU's clock (RM0090 section 7.3.2)."""
    rcc.write(S, PLLCFGR, m | n << 6 | p << 16 | 1 << 22)
    rcc.write(S, CFGR, 2)
    assert S[HZ] == hz


def test_oscillators_take_time(S):
    """HSERDY follows HSEON after the crystal's start-up time, not at once."""
    rcc.write(S, CR, 0x83 | 1 << 16)
    assert not rcc.read(S, CR) >> 17 & 1
    S[CYCLES] = 16_000_000 * rcc.HSE_START_NS // 10**9
    assert rcc.read(S, CR) >> 17 & 1


def test_ahb_prescaler_divides(S):
    """HPRE of 8 to 15 divides by 2 to 512, without 32."""
    rcc.write(S, CFGR, 0x80)
    assert S[HZ] == 8_000_000
    rcc.write(S, CFGR, 0xC0)
    assert S[HZ] == 250_000


def test_time_is_continuous_across_a_clock_change(S):
    """Changing the clock changes how fast time passes from then on, not the time."""
    S[BASE_NS] = -100
    S[CYCLES] = 16_000
    before = clock.now_ns(S)
    assert before == 1_000_000 - 100
    clock.set_hz(S, 22_000_000, S[CYCLES])
    assert clock.now_ns(S) == before
    S[CYCLES] += 22_000
    assert clock.now_ns(S) == before + 1_000_000


@pytest.mark.parametrize("base_ns", [0, -100_000_000, 7])
def test_deadline_is_the_first_cycle_not_before(S, base_ns):
    """The cycle count of an instant is the first that is not earlier, over hours, without overflow."""
    S[HZ] = 22_000_000
    S[BASE_NS] = base_ns
    for t_ns in (0, 1, 45, 46, 1000, 10**9 + 1, 3600 * 10**9, 40 * 3600 * 10**9 + 13):
        cycles = clock.cycles_at(S, t_ns)
        exact = (t_ns - base_ns) * 22  # cycles times a thousand
        assert cycles * 1000 >= exact > (cycles - 1) * 1000
        assert clock.ns_of(S, cycles) - t_ns in range(46)

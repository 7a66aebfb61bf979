"""Cycles as time."""

import pytest

from targets.mcu import clock
from targets.mcu.state import BASE_NS, CYCLES, HZ, allocate


@pytest.fixture
def S():
    S = allocate()
    S[HZ] = 16_000_000
    return S


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

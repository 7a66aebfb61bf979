"""Rates, bounds and times against published values."""

import math
import statistics

import pytest

from campaigns.statistics import Rate, alarm_rate_bound, mean_and_deviation, middle, sign_test, times


@pytest.mark.parametrize(
    ("hits", "n", "low", "high"),
    [
        # Newcombe, Statistics in Medicine 17 (1998) 857-872, Table I, method 3
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0000, 0.1611),
        (1, 29, 0.0061, 0.1718),
        (10, 10, 0.7225, 1.0000),
    ],
)
def test_wilson(hits, n, low, high):
    """The interval of a rate is Wilson's, to the digits published."""
    assert Rate(hits, n).interval == pytest.approx((low, high), abs=5e-5)


def test_interval_within_bounds():
    """An interval never leaves 0 to 1, holds its rate, and mirrors that of the complement."""
    for n in (1, 3, 20, 1000):
        for hits in range(0, n + 1, max(1, n // 7)):
            low, high = Rate(hits, n).interval
            assert 0.0 <= low <= high <= 1.0
            assert low <= hits / n + 1e-12
            assert hits / n <= high + 1e-12
            assert Rate(n - hits, n).interval == pytest.approx((1 - high, 1 - low))


def test_rate_of_none():
    """A rate of no run does not exist; it is not zero."""
    rate = Rate(0, 0)
    assert math.isnan(rate.value)
    assert all(map(math.isnan, rate.interval))


@pytest.mark.parametrize("hours", [0.5, 1.0, 100.0])
def test_rule_of_three(hours):
    """No alarm in T hours bounds the rate by 3/T."""
    assert alarm_rate_bound(0, hours) == pytest.approx(3 / hours)


@pytest.mark.parametrize(
    ("alarms", "bound"),
    # half the 95 % quantile of chi-square with 2(k + 1) degrees of freedom
    [(1, 4.744), (2, 6.296), (3, 7.754), (5, 10.513), (10, 16.962), (20, 29.062), (50, 63.287)],
)
def test_poisson_bound(alarms, bound):
    """With alarms the bound is that of a Poisson count, per hour."""
    assert alarm_rate_bound(alarms, 1.0) == pytest.approx(bound, abs=5e-4)
    assert alarm_rate_bound(alarms, 4.0) == pytest.approx(bound / 4, abs=5e-4)


def test_many_alarms():
    """A count whose e^-m underflows still has its bound, near k + 1.645 sqrt(k)."""
    assert alarm_rate_bound(2000, 1.0) == pytest.approx(2000 + 1.645 * math.sqrt(2000), rel=2e-3)


def test_bound_of_no_time():
    """No time ridden bounds nothing."""
    assert math.isnan(alarm_rate_bound(0, 0.0))


def test_times():
    """Times to detect are in seconds; what was not detected is left out, not averaged."""
    found = times([1_000_000_000, None, 4_000_000_000, 2_000_000_000, None, 3_000_000_000])
    assert sorted(found.values_s) == [1.0, 2.0, 3.0, 4.0]
    assert (found.mean, found.median, found.longest) == (2.5, 2.5, 4.0)
    assert found.deviation == pytest.approx(1.2909944)


def test_median_of_odd():
    """The median of an odd number of times is the middle one."""
    assert times([9_000_000_000, 1_000_000_000, 2_000_000_000]).median == 2.0


def test_times_of_none_and_one():
    """No time has no mean, a single one no deviation."""
    nothing, single = times([None]), times([700_000_000])
    assert all(map(math.isnan, (nothing.mean, nothing.deviation, nothing.median, nothing.longest)))
    assert (single.mean, single.median, single.longest) == (0.7, 0.7, 0.7)
    assert math.isnan(single.deviation)


def test_mean_and_deviation():
    """Sums of cycles give the mean and sample deviation that the values themselves give."""
    cycles = [5491 + k * k % 37 for k in range(10_000)]
    found = mean_and_deviation(len(cycles), sum(cycles), sum(c * c for c in cycles))
    assert found == pytest.approx((statistics.fmean(cycles), statistics.stdev(cycles)), rel=1e-6)


def test_mean_and_deviation_of_few():
    """Equal values deviate by nothing, one value has no deviation, none has no mean."""
    assert mean_and_deviation(3, 21.0, 147.0) == (7.0, 0.0)
    assert mean_and_deviation(1, 7.0, 49.0)[0] == 7.0
    assert math.isnan(mean_and_deviation(1, 7.0, 49.0)[1])
    assert all(map(math.isnan, mean_and_deviation(0, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("hits", "n", "bound"),
    # 0.05 ** (1/n) for all of n; the others from Brown, Cai and DasGupta's definition, by scipy's binomtest
    [(20, 20, 0.860892), (100, 100, 0.970487), (19, 20, 0.783894), (5, 10, 0.222441), (0, 20, 0.0)],
)
def test_supported(hits, n, bound):
    """The rate supported at 95 % is Clopper and Pearson's one-sided lower bound."""
    assert Rate(hits, n).supported == pytest.approx(bound, abs=5e-7)


def test_supported_is_exact():
    """At the bound, as many hits or more come up in one of twenty experiments; none supports nothing."""
    hits, n = 37, 41
    p = Rate(hits, n).supported
    tail = sum(math.comb(n, k) * p**k * (1 - p) ** (n - k) for k in range(hits, n + 1))
    assert tail == pytest.approx(0.05, rel=1e-9)
    assert math.isnan(Rate(0, 0).supported)


def test_percentile():
    """A percentile lies between the values on both sides of it, by distance; one value is all of them."""
    found = times([k * 1_000_000_000 for k in (5, 1, 4, 2, 3)])
    assert [found.percentile(p) for p in (0, 50, 95, 100)] == pytest.approx([1.0, 3.0, 4.8, 5.0])
    assert times([2_000_000_000]).percentile(95) == 2.0
    assert math.isnan(times([]).percentile(95))


def test_median_with_infinite():
    """What never came counts as infinite: the median is finite while less than half are missing."""
    assert middle([3.0, math.inf, 1.0, math.inf, 2.0]) == 3.0
    assert middle([3.0, math.inf]) == math.inf


@pytest.mark.parametrize(
    ("more", "fewer", "p"),
    [(0, 0, 1.0), (5, 5, 1.0), (0, 5, 0.0625), (8, 2, 0.109375), (2, 8, 0.109375), (0, 1, 1.0)],
)
def test_sign_test(more, fewer, p):
    """The exact two-sided p of so many changes one way and the other."""
    assert sign_test(more, fewer) == pytest.approx(p)


def test_sign_test_of_many():
    """Thousands of changes do not overflow."""
    assert sign_test(4000, 6000) < 1e-80

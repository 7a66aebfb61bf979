"""Rates with their intervals, and times to detect. Every figure carries its n."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

Z95 = 1.959963984540054


@dataclass(frozen=True)
class Rate:
    """`hits` of `n` with the 95 % Wilson score interval; fractions of 1, NaN where n is 0."""

    hits: int
    n: int

    @property
    def value(self) -> float:
        """hits / n."""
        return self.hits / self.n if self.n else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson (1927): the p for which the observed rate lies z standard errors away."""
        if not self.n:
            return math.nan, math.nan
        # (p + z^2/2n +- z sqrt(p(1-p)/n + z^2/4n^2)) / (1 + z^2/n)
        p, n, z2 = self.value, self.n, Z95 * Z95
        centre = p + z2 / (2 * n)
        reach = Z95 * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
        scale = 1 + z2 / n
        return max(0.0, (centre - reach) / scale), min(1.0, (centre + reach) / scale)

    @property
    def supported(self) -> float:
        """What the true rate is at least with 95 % confidence: Clopper and Pearson's one-sided bound."""
        if not self.n:
            return math.nan
        if not self.hits:
            return 0.0
        from scipy.special import betaincinv

        # P(X >= hits | p) = I_p(hits, n - hits + 1) = 0.05, exactly
        return float(betaincinv(self.hits, self.n - self.hits + 1, 0.05))


@dataclass(frozen=True)
class Times:
    """Times to detect, s: of the correct detections alone, the others are counted as missed, not averaged."""

    values_s: tuple[float, ...]

    @property
    def mean(self) -> float:
        """Arithmetic mean, NaN if there is none."""
        return sum(self.values_s) / len(self.values_s) if self.values_s else math.nan

    @property
    def deviation(self) -> float:
        """Sample standard deviation, NaN for fewer than two."""
        n = len(self.values_s)
        if n < 2:
            return math.nan
        return math.sqrt(sum((value - self.mean) ** 2 for value in self.values_s) / (n - 1))

    @property
    def median(self) -> float:
        """The middle value, NaN if there is none."""
        return middle(self.values_s)

    def percentile(self, percent: float) -> float:
        """The value below which `percent` lie, between two by their distances; NaN if there is none."""
        ordered = sorted(self.values_s)
        if not ordered:
            return math.nan
        # Hyndman and Fan's seventh definition, that of numpy, R and spreadsheets
        place = (len(ordered) - 1) * percent / 100.0
        below = min(int(place), len(ordered) - 1)
        above = min(below + 1, len(ordered) - 1)
        return ordered[below] + (place - below) * (ordered[above] - ordered[below])

    @property
    def longest(self) -> float:
        """The largest value, NaN if there is none."""
        return max(self.values_s, default=math.nan)


def alarm_rate_bound(alarms: int, hours: float) -> float:
    """Upper 95 % bound of the false alarms per hour after `alarms` in `hours`, NaN for no time at all.

    Zero alarms give 3/T (the rule of three, -ln 0.05 / T); more give the Poisson bound by bisection.
    """
    if hours <= 0:
        return math.nan
    low, high = float(alarms), alarms + 10 + 5 * math.sqrt(alarms + 1)
    for _ in range(60):
        mean = (low + high) / 2
        low, high = (mean, high) if _poisson_cdf(alarms, mean) > 0.05 else (low, mean)
    return (3.0 if alarms == 0 else high) / hours


def _poisson_cdf(k: int, mean: float) -> float:
    # sum of e^-m m^i / i!, by logarithms: e^-m alone is zero in floating point from m = 746 on
    return math.fsum(math.exp(i * math.log(mean) - mean - math.lgamma(i + 1)) for i in range(k + 1))


def middle(values: Sequence[float]) -> float:
    """Median, NaN of none; a value may be infinite, as a time that did not come."""
    ordered = sorted(values)
    n = len(ordered)
    return (ordered[(n - 1) // 2] + ordered[n // 2]) / 2 if n else math.nan


def sign_test(more: int, fewer: int) -> float:
    """Two-sided exact p of `more` against `fewer` where both are as likely; 1 of none.

    Of the pairs whose verdicts differ this is McNemar's test (1947), exact.
    """
    from scipy.special import bdtr

    return min(1.0, 2.0 * float(bdtr(min(more, fewer), more + fewer, 0.5)))


def mean_and_deviation(n: int, total: float, squares: float) -> tuple[float, float]:
    """Mean and sample standard deviation from the sums, NaN where they do not exist."""
    if n == 0:
        return math.nan, math.nan
    mean = total / n
    return mean, math.sqrt(max(squares - total * mean, 0.0) / (n - 1)) if n > 1 else math.nan


def times(values_ns: Sequence[int | None]) -> Times:
    """Times in s from nanoseconds, those that do not exist left out."""
    return Times(tuple(value / 1e9 for value in values_ns if value is not None))

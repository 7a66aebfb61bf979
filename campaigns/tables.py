"""The road trial's tables (V.14, V.15) and the step time (V.13), ours beside the thesis's."""

import math
import tomllib
from collections.abc import Iterable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from bench.verdict import Outcome
from campaigns.plan import FAULT_FREE, HERE, Campaign
from campaigns.statistics import Rate, alarm_rate_bound, mean_and_deviation, times
from campaigns.trial import Result

if TYPE_CHECKING:
    from rich.console import RenderableType

NAMES = {
    "open": "Open circuit",
    "short": "Short circuit",
    "hold": "Hold",
    "uncalibration": "Losing calibration",
}


@cache
def thesis() -> dict[str, Any]:
    """The published figures."""
    return tomllib.loads((HERE / "thesis.toml").read_text(encoding="utf-8"))


def road(campaign: Campaign, results: Sequence[Result]) -> "list[RenderableType]":
    """What a road trial prints: invalid runs first, then the tables."""
    valid = [r for r in results if r.outcome is not Outcome.INVALID]
    return [
        _invalid(results),
        _detection(campaign, valid),
        _times(campaign, valid),
        _steps(valid),
    ]


def _invalid(results: Sequence[Result]) -> str:
    invalid = [r for r in results if r.outcome is Outcome.INVALID]
    if not invalid:
        return f"INVALID runs: none of {len(results)}"
    from rich.markup import escape

    lines = [f"[bold red]INVALID runs: {len(invalid)} of {len(results)}, they enter no rate[/]"]
    lines += [f"  {escape(f'{r.trial.condition}, lap {r.trial.lap_seed}: {r.reason}')}" for r in invalid]
    return "\n".join(lines)


def _detection(campaign: Campaign, valid: Sequence[Result]) -> "RenderableType":
    from rich.table import Table

    table = Table(title="Table V.14  Diagnostic performance", title_justify="left")
    for column in ("Condition", "n", "CD %", "95 % interval", "MD", "FA", "ID", "thesis CD %"):
        table.add_column(column, justify="left" if column == "Condition" else "right")
    published = thesis()["road"]["CD"]
    for condition in campaign.faults:
        runs = _of(valid, condition)
        rate = Rate(_count(runs, Outcome.CD), len(runs))
        others = [str(_count(runs, outcome)) for outcome in (Outcome.MD, Outcome.FA, Outcome.ID)]
        figure = published.get(condition)
        table.add_row(
            NAMES.get(condition, condition),
            str(rate.n),
            _percent(rate.value),
            _range(rate.interval),
            *others,
            "-" if figure is None else f"{figure:.0f}",
        )
    free = _of(valid, FAULT_FREE)
    false = Rate(_count(free, Outcome.FA), len(free))
    hours = sum(r.ridden_ns for r in free) / 3.6e12
    bound = alarm_rate_bound(false.hits, hours)
    table.caption = (
        f"Fault-free: FA {_percent(false.value)} % of {false.n} laps "
        f"(95 % interval {_range(false.interval)}; thesis 0 %); "
        f"{hours:.2f} h ridden, at most {bound:.1f} false alarms/h at 95 %"
    )
    table.caption_justify = "left"
    return table


def _times(campaign: Campaign, valid: Sequence[Result]) -> "RenderableType":
    from rich.table import Table

    table = Table(title="Table V.15  Time to detect, s", title_justify="left")
    for column in ("Condition", "n", "mean", "sigma", "median", "max", "thesis mean, sigma"):
        table.add_column(column, justify="left" if column == "Condition" else "right")
    published = thesis()["road"]["TD_s"]
    for condition in campaign.faults:
        runs = _of(valid, condition)
        td = times([r.td_ns for r in runs])
        mean, deviation = published.get(condition, (math.nan, math.nan))
        shown = (td.mean, td.deviation, td.median, td.longest)
        table.add_row(
            NAMES.get(condition, condition),
            str(len(td.values_s)),
            *(_number(value, 2) for value in shown),
            f"{_number(mean, 1)}, {_number(deviation, 1)}",
        )
    return table


def _steps(valid: Sequence[Result]) -> "RenderableType":
    from rich.table import Table

    timed = [r for r in valid if r.hz and r.steps]
    table = Table(title="Table V.13  Execution time of one step, us", title_justify="left")
    for column in ("Code", "clock", "n", "mean", "sigma", "min", "max"):
        table.add_column(column, justify="left" if column == "Code" else "right")
    if timed:
        hz = timed[0].hz
        n = sum(r.steps for r in timed)
        mean, deviation = mean_and_deviation(n, sum(r.cycles for r in timed), sum(r.squares for r in timed))
        least, most = min(r.least for r in timed), max(r.most for r in timed)
        figures = (f"{value * 1e6 / hz:.1f}" for value in (mean, deviation, least, most))
        table.add_row("this firmware", f"{hz / 1e6:g} MHz", str(n), *figures)
    rows = thesis()["firmware"]["time_us"][0]
    for name, (mean, deviation) in zip(("initial", "compiler", "final"), rows, strict=True):
        table.add_row(f"thesis, {name}", "22 MHz", "1000", f"{mean:.1f}", f"{deviation:.1f}", "-", "-")
    table.caption = (
        "Ours by the cycle model. Of the thesis's three rows the slowest: we read the rows as three clocks, "
        "of which the text names 22 MHz."
    )
    table.caption_justify = "left"
    return table


def _of(results: Iterable[Result], condition: str) -> list[Result]:
    return [r for r in results if r.trial.condition == condition]


def _count(results: Iterable[Result], outcome: Outcome) -> int:
    return sum(r.outcome is outcome for r in results)


def _percent(value: float) -> str:
    return "-" if math.isnan(value) else f"{100 * value:.0f}"


def _range(interval: tuple[float, float]) -> str:
    return f"{_percent(interval[0])}-{_percent(interval[1])}"


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"

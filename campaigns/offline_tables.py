"""The offline campaign's tables: V.1-V.12 beside the thesis's, times to detect, SOE, both feedbacks.

Belongs here: a document's figures (`offline_score`) as grids of text. Never: a rate, a screen.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from bench.faults.spec import parse_fault
from campaigns.offline_plan import OfflineCampaign, t_key
from campaigns.offline_score import GREY, OUTCOMES, PROMPT_S, chosen
from campaigns.sheets import Cell, at
from campaigns.store import Document
from campaigns.thesis import NAMES, thesis

Published = Mapping[tuple[int, int], Mapping[str, float]]
"""(L in ms, n) -> outcome -> percent."""

FIRST = {"uncalibration": 1, "open": 4, "short": 7, "hold": 10}
"""Condition of `thesis.toml` -> the first of its three tables V."""
FAULTS = {
    str(parse_fault(f"{fault}@0")): name
    for name, fault in {
        "uncalibration": "rear_stroke:uncalibration:gain=1.1",
        "open": "rear_stroke:open",
        "short": "rear_stroke:short",
        "hold": "rear_stroke:hold",
    }.items()
}
"""What the thesis inserted -> its condition."""
WORDS = {"FA": "False Alarm", "CD": "Correct Detection", "MD": "Missed Detection"}


class Grid(NamedTuple):
    """A table; a cell's text may have two lines. grey: (row, column) of the cells in the grey region."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    grey: frozenset[tuple[int, int]] = frozenset()
    caption: str = ""


def grids(plan: OfflineCampaign, document: Document) -> Iterator[Grid]:
    """Every table: the summaries, V.1-V.12 and the times to detect for each feedback and T, SOE."""
    conditions = list(dict.fromkeys(cell["condition"] for cell in document["cells"]))
    if conditions:
        yield from (summary(plan, document, t) for t in plan.T_percent)
    for feedback in _feedbacks(document):
        for t in plan.T_percent:
            for condition in conditions:
                for outcome in OUTCOMES:
                    yield detection(plan, document, feedback, t, condition, outcome)
            for condition in conditions:
                yield delays(plan, document, feedback, t, condition)
    if document["soe"]:
        yield soe(plan, document)


def invalid(document: Document) -> str:
    """How many faults never acted, in words: they enter no rate."""
    lost = [row for row in document["invalid"] if row["INVALID"]]
    if not lost:
        return f"INVALID faults: none of {sum(row['n'] for row in document['invalid'])}"
    words = ", ".join(
        f"{row['INVALID']} of {row['n']} {row['condition']} ({row['feedback']})" for row in lost
    )
    return f"INVALID faults, which changed no sample and enter no rate: {words}"


def thesis_condition(plan: OfflineCampaign, condition: str) -> str | None:
    """Which of the thesis's four faults the plan's condition is."""
    return FAULTS.get(str(parse_fault(f"{plan.faults[condition]}@0")))


def published(plan: OfflineCampaign, feedback: str, T_percent: float, condition: str) -> Published:
    """The thesis's three tables for this condition; empty where it ran nothing like it."""
    name = thesis_condition(plan, condition)
    if name is None or (feedback, T_percent, plan.t_max_s) != ("predicted", 10.0, 120.0):
        return {}
    offline = thesis()["offline"]
    return {
        (L, n): {outcome: offline[name][outcome][k][j] for outcome in OUTCOMES}
        for k, n in enumerate(offline["n"])
        for j, L in enumerate(offline["L_ms"])
    }


def is_grey(percents: Mapping[str, float]) -> bool:
    """Whether a published cell lies in the grey region."""
    return all(percents[outcome] <= 100.0 * most for outcome, most in GREY.items())


def summary(plan: OfflineCampaign, document: Document, T_percent: float) -> Grid:
    """At a glance: how often each fault is found at one cell, in every feedback, and in the thesis.

    The cell is the best of the first feedback; of equally good ones the one that was best in the thesis.
    """
    feedbacks, cells = _feedbacks(document), _cells(document, T_percent)
    known = {name: published(plan, feedbacks[0], T_percent, name) for name in plan.faults}
    every = [tables for tables in known.values() if tables]
    prefer = {key: min(one[key]["CD"] for one in every) for key in every[0]} if every else {}
    best = chosen(document, feedbacks[0], T_percent, prefer)
    assert best is not None, "a summary of no cell"
    L, n = best["L_ms"], best["n"]
    heads = ["Fault", "of", "grey", "thesis", f"CD %, {feedbacks[0]}", "thesis"]
    heads += [f"CD %, {name}" for name in feedbacks[1:]]
    rows = []
    for condition, cell in best["cells"].items():
        own = [c["grey"] for key, c in cells.items() if key[:2] == (feedbacks[0], condition)]
        theirs = [is_grey(percents) for percents in known[condition].values()]
        more = [cells[name, condition, L, n] for name in feedbacks[1:]]
        rows.append(
            (
                Cell(NAMES.get(condition, condition)),
                _keyed(str(cell["of"]), cell, "of"),
                Cell(f"{sum(own)}/{len(own)}"),
                Cell(f"{sum(theirs)}/{len(theirs)}" if theirs else "-"),
                _rate(cell, "CD"),
                Cell(_published(known[condition], L, n, "CD")),
                *(_rate(one, "CD") for one in more),
            )
        )
    title = f"Correct detections at L = {L} ms, n = {n}, T = {T_percent:g} %, for each feedback"
    caption = (
        f"grey: cells (L, n) with FA <= {100 * GREY['FA']:g} % and MD <= {100 * GREY['MD']:g} %; this one is "
        f"grey for {best['grey']} of {len(rows)} faults."
    )
    lost = [name for name, cell in best["cells"].items() if _fewer(cells.get(("measured", name, L, n)), cell)]
    if feedbacks[0] == "predicted" and lost:
        caption += (
            "\nA negative result: fed back with the measured stroke, the network follows the faulty sensor, "
            f"and fewer are found of {', '.join(NAMES.get(name, name).lower() for name in lost)}"
        )
    return Grid(title, tuple(heads), tuple(rows), caption=caption)


def detection(
    plan: OfflineCampaign, document: Document, feedback: str, T_percent: float, condition: str, outcome: str
) -> Grid:
    """One of Tables V.1-V.12: ours with * in the grey region, the thesis's, our 95 % interval."""
    known = published(plan, feedback, T_percent, condition)
    cells = _cells(document, T_percent)
    rows, grey = [], set()
    for k, n in enumerate(plan.n):
        row = [Cell(str(n))]
        for j, L in enumerate(plan.L_ms, 1):
            cell = cells[feedback, condition, L, n]
            ours = f"{_percent(cell, outcome)}{'*' if cell['grey'] else ' '}"
            # one line holds no three figures in 120 columns
            theirs = f" {_published(known, L, n, outcome):>5}\n" if known else " "
            text = f"{ours}{theirs}{_interval(cell, outcome)}"
            row.append(_keyed(text, cell, f"rates.{outcome}"))
            if cell["grey"]:
                grey.add((k, j))
        rows.append(tuple(row))
    name = thesis_condition(plan, condition)
    number = f"Table V.{FIRST[name] + OUTCOMES.index(outcome)}  " if name and known else ""
    title = (
        f"{number}{NAMES.get(condition, condition)}: {WORDS[outcome]} percentage, T = {T_percent:g} %, "
        f"feedback {feedback}{'; ours, thesis, 95 % interval' if known else ' (95 % interval)'}"
    )
    return Grid(title, _heads(plan), tuple(rows), frozenset(grey))


def delays(
    plan: OfflineCampaign, document: Document, feedback: str, T_percent: float, condition: str
) -> Grid:
    """Mean time to detect of each cell, and which share of its detections is prompt."""
    cells = _cells(document, T_percent)
    rows = []
    for n in plan.n:
        row = [Cell(str(n))]
        for L in plan.L_ms:
            cell = cells[feedback, condition, L, n]
            mean, prompt = cell["td_s"]["mean"], cell["td_s"]["prompt"]
            if mean is None:
                row.append(_keyed("-      ", cell, "td_s"))
                continue
            mark = " " if mean < n * L / 1000.0 + PROMPT_S else "!"
            row.append(_keyed(f"{mean:.2f}{mark} {100 * prompt:3.0f} %", cell, "td_s"))
        rows.append(tuple(row))
    title = (
        f"{NAMES.get(condition, condition)}: mean time to detect, s; share below L_obs + {PROMPT_S:g} s, "
        f"T = {T_percent:g} %, feedback {feedback}"
    )
    caption = f"! mean not below L_obs + {PROMPT_S:g} s, L_obs = n L; in the thesis it is, for every fault"
    return Grid(title, _heads(plan), tuple(rows), caption=caption)


def soe(plan: OfflineCampaign, document: Document) -> Grid:
    """Figures V.6 and V.7 in figures: the E_mean,L that a tenth of the healthy windows exceed."""
    heads = ["L"]
    for name in document["soe"]:
        heads += [f"{name}: tenth", "hundredth", *(f"> {t:g} %" for t in plan.T_percent)]
    known = thesis()["narx_grid"]["chosen"]["SOE_worst10_percent"]
    first = next(iter(document["soe"].values()))
    rows = []
    for L in first:
        row = [f"{L} ms"]
        for curves in document["soe"].values():
            row += [f"{curves[L]['worst_tenth_percent']:.2f}", f"{curves[L]['worst_hundredth_percent']:.2f}"]
            row += [f"{100 * curves[L]['beyond'][t_key(t)]:.3f}" for t in plan.T_percent]
        row.append(f"{known[f'L_{L}ms']:g}" if f"L_{L}ms" in known else "-")
        rows.append(tuple(map(Cell, row)))
    title = (
        "Figures V.6, V.7  E_mean,L of the healthy laps, %: what a tenth and a hundredth of the windows "
        "exceed, and the share beyond T"
    )
    return Grid(title, (*heads, "thesis: tenth"), tuple(rows))


def _fewer(cell: Document | None, other: Document) -> bool:
    """Whether a cell's CD is below another's by more than both their intervals."""
    if cell is None or not (cell["of"] and other["of"]):
        return False
    return bool(cell["rates"]["CD"]["interval"][1] < other["rates"]["CD"]["interval"][0])


def _heads(plan: OfflineCampaign) -> tuple[str, ...]:
    return ("n \\ L", *(f"{L} ms" for L in plan.L_ms))


def _feedbacks(document: Document) -> Sequence[str]:
    return list(dict.fromkeys(cell["feedback"] for cell in document["cells"]))


def _cells(document: Document, T_percent: float) -> dict[tuple[str, str, int, int], Document]:
    return {
        (cell["feedback"], cell["condition"], cell["L_ms"], cell["n"]): cell
        for cell in document["cells"]
        if cell["T_percent"] == T_percent
    }


def _percent(cell: Document, outcome: str) -> str:
    return f"{100.0 * cell[outcome] / cell['of']:.1f}" if cell["of"] else "-"


def _interval(cell: Document, outcome: str) -> str:
    low, high = cell["rates"][outcome]["interval"]
    return "-" if low is None else f"{100.0 * low:.1f}-{100.0 * high:.1f}"


def _rate(cell: Document, outcome: str) -> Cell:
    return _keyed(f"{_percent(cell, outcome)} ({_interval(cell, outcome)})", cell, f"rates.{outcome}")


def _keyed(text: str, cell: Document, path: str) -> Cell:
    """A figure with its place in the document, and what stands there."""
    return Cell(text, f"{cell['key']}.{path}", at(cell, path))


def _published(known: Published, L: int, n: int, outcome: str) -> str:
    return f"{known[L, n][outcome]:.1f}" if (L, n) in known else "-"

"""The offline campaign's rows in figures: outcome counts of every cell, with intervals and times to detect.

Belongs here: outcomes and aggregates, from the trials' documents and results alone. Never: a screen, a lap.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from campaigns.offline_plan import OfflineCampaign, t_key
from campaigns.outcomes import rate

Document = Mapping[str, Any]

OUTCOMES = ("FA", "CD", "MD")
GREY = {"FA": 0.01, "MD": 0.02}
"""The grey regions of Tables V.1-V.12: at most so many false alarms, and missed detections."""
NEVER = int(np.iinfo(np.int64).max)
"""The instant of an alarm that never comes: later than any."""
PROMPT_S = 2.0
"""The thesis: found within L_obs and so much more, on average."""


def score(plan: OfflineCampaign, rows: Iterable[tuple[Document, Document]]) -> dict[str, Any]:
    """Every table's figures: `rows` are trials' documents with their results, in any order.

    {"n": trials, "cells": one a feedback, T, condition, L and n, "invalid": faults that never acted, "soe":
    feedback -> L in ms -> curve}. Rates are fractions of 1.
    """
    faults: dict[tuple[str, str], list[Document]] = {}
    soe = {}
    for trial, result in rows:
        if trial["kind"] == "offline_soe":
            # a store sorts keys as text
            soe[trial["feedback"]] = dict(sorted(result["curves"].items(), key=lambda item: int(item[0])))
        else:
            faults.setdefault((trial["feedback"], trial["condition"]), []).append(result)
    cells, invalid = [], []
    for feedback in plan.feedback:
        for condition in plan.faults:
            results = faults.get((feedback, condition), [])
            if not results:
                continue
            valid = [result for result in results if result["t_active_ns"] is not None]
            invalid.append(
                {
                    "feedback": feedback,
                    "condition": condition,
                    "n": len(results),
                    "INVALID": len(results) - len(valid),
                }
            )
            cells += _cells(plan, feedback, condition, valid)
    return {
        "n": sum(map(len, faults.values())),
        "cells": cells,
        "invalid": invalid,
        "soe": {name: soe[name] for name in plan.feedback if name in soe},
    }


def _cells(
    plan: OfflineCampaign, feedback: str, condition: str, valid: Sequence[Document]
) -> list[dict[str, Any]]:
    """The cells of one condition and feedback, in the order T, L, n."""
    active = np.array([result["t_active_ns"] for result in valid], dtype=np.int64)
    found = []
    for t in plan.T_percent:
        alarms = [result["first_alarm_ns"][t_key(t)] for result in valid]
        # (faults, L, n)
        first = np.array(
            [[[(NEVER if ns is None else ns) for ns in row] for row in one] for one in alarms], dtype=np.int64
        )
        for j, ms in enumerate(plan.L_ms):
            for k, n in enumerate(plan.n):
                column = first[:, j, k] if valid else np.zeros(0, np.int64)
                parameters = {"feedback": feedback, "T_percent": t, "L_ms": ms, "n": n}
                key = ",".join(f"{name}={value}" for name, value in parameters.items())
                figures = counted(column, active, plan.t_max_s, n * ms / 1000.0)
                found.append({"key": f"{condition}[{key}]", "condition": condition, **parameters, **figures})
    return found


def counted(
    first: NDArray[np.int64], active: NDArray[np.int64], t_max_s: float, observed_s: float = 0.0
) -> dict[str, Any]:
    """The figures of one detector: FA, CD and MD exclude each other and add up to every valid fault.

    first, active (faults,): instants of the first alarm, NEVER for none, and of the fault, ns. observed_s:
    L_obs, for how long the detector must look before it raises an alarm.
    """
    false = first < active
    detected = ~false & (first - active <= round(t_max_s * 1e9))
    counts = {"FA": int(false.sum()), "CD": int(detected.sum())}
    counts["MD"] = len(first) - counts["FA"] - counts["CD"]
    delay_ns = first[detected] - active[detected]
    prompt = int((delay_ns < (observed_s + PROMPT_S) * 1e9).sum())
    return {
        "of": len(first),
        **counts,
        "rates": {name: rate(hits, len(first)) for name, hits in counts.items()},
        "grey": bool(len(first)) and all(counts[name] / len(first) <= most for name, most in GREY.items()),
        # a sum of integers is the same in any order
        "td_s": {
            "mean": int(delay_ns.sum()) / 1e9 / counts["CD"] if counts["CD"] else None,
            "prompt": prompt / counts["CD"] if counts["CD"] else None,
        },
    }


def chosen(
    document: Document, feedback: str, T_percent: float, prefer: Mapping[tuple[int, int], float]
) -> dict[str, Any] | None:
    """The cell (L, n) to choose: grey for most conditions, largest least CD, most preferred.

    {"L_ms", "n", "grey": for how many conditions, "cells": condition -> its cell}; None without any cell.
    """
    where: dict[tuple[int, int], dict[str, Any]] = {}
    for cell in document["cells"]:
        if (cell["feedback"], cell["T_percent"]) == (feedback, T_percent):
            where.setdefault((cell["L_ms"], cell["n"]), {})[cell["condition"]] = cell

    def merit(key: tuple[int, int]) -> tuple[int, float, float]:
        cells = where[key].values()
        least = min(cell["CD"] / cell["of"] if cell["of"] else 0.0 for cell in cells)
        return sum(cell["grey"] for cell in cells), least, prefer.get(key, 0.0)

    if not where:
        return None
    best = max(where, key=merit)
    return {"L_ms": best[0], "n": best[1], "grey": merit(best)[0], "cells": where[best]}

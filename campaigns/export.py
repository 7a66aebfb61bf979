"""Rows of a store as files: JSON with the tables, CSV and Parquet of one row a trial.

Belongs here: columns, formats. Never: a figure that is not in a row or in the tables, a clock, a host's name.
Same rows, same bytes; a file is written whole or not at all.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.whole import whole
from campaigns.detection import detection_curves
from campaigns.errors import CampaignError
from campaigns.outcomes import outcomes
from campaigns.store import Document, Row

LEADING = (
    *("id", "condition", "parameters.", "lap.", "fault", "outcome", "reason", "named"),
    *("t_cmd_s", "t_active_s", "t_obs_s", "t_alarm_s", "t_heal_s", "td_s", "alarms", "ridden_s"),
)
"""Columns, or beginnings of columns, that come first and in this order; the others follow by name."""


def document(campaign: Document, tables: Document, rows: Iterable[Row]) -> Document:
    """A campaign as it is published: what it was, its tables, and every trial with its result."""
    trials = [{"id": row.id, "trial": row.trial, "result": row.result} for row in by_id(rows)]
    whole_document: Document = _without_nan({"campaign": campaign, "tables": tables, "trials": trials})
    return whole_document


def road_tables(rows: Iterable[Row], order: Sequence[str] = (), ftti_s: float | None = None) -> Document:
    """The tables of road trials: `outcomes`, and the detection curves of a sweep as "curves"."""
    rows = list(rows)
    return {**outcomes(rows, order, ftti_s), "curves": detection_curves(rows)}


def flat(row: Row) -> Document:
    """A row as columns: nested names joined by points, times in seconds."""
    return {"id": row.id, **flat_columns(row.trial), **flat_columns(row.result)}


def write_json(path: Path, report: Document) -> None:
    """Write a document as JSON. Raises CampaignError."""
    text = json.dumps(_without_nan(report), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    write_text(path, text)


def write_csv(path: Path, rows: Iterable[Row]) -> None:
    """Write one line a trial; what did not happen is an empty cell. Raises CampaignError."""
    names, table = _table(rows)
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(names)
    lines.writerows([_text(line[name]) for name in names] for line in table)
    write_text(path, text.getvalue())


def write_parquet(path: Path, rows: Iterable[Row], campaign: Document | None = None) -> None:
    """Write one line a trial, what did not happen as null, the campaign in the file's metadata."""
    import pyarrow as pa
    from pyarrow import parquet

    names, table = _table(rows)
    columns = [_arrow(name, [line[name] for line in table]) for name in names]
    note = {"strokebench.campaign": json.dumps(_without_nan(campaign), sort_keys=True)} if campaign else None
    # Opened here, for Arrow's own refusals are long and name the part.
    with whole(path, CampaignError) as part, part.open("wb") as file:
        parquet.write_table(pa.table(columns, names=names, metadata=note), file)


def write_text(path: Path, text: str) -> None:
    """Write a text, whole or not at all. Raises CampaignError."""
    with whole(path, CampaignError) as part:
        # A lap's file name may hold bytes that are no text.
        part.write_text(text, encoding="utf-8", errors="backslashreplace", newline="")


def by_id(rows: Iterable[Row]) -> list[Row]:
    """The rows in the one order that does not depend on who finished first."""
    return sorted(rows, key=lambda row: row.id)


def _table(rows: Iterable[Row]) -> tuple[list[str], list[Document]]:
    lines = [flat(row) for row in by_id(rows)]
    names = sorted({name for line in lines for name in line} or {"id"}, key=_place)
    return names, [{name: line.get(name) for name in names} for line in lines]


def _place(name: str) -> tuple[int, str]:
    for place, leading in enumerate(LEADING):
        if name == leading or (leading.endswith(".") and name.startswith(leading)):
            return place, name
    return len(LEADING), name


def flat_columns(part: Mapping[str, Any], prefix: str = "") -> Document:
    """A document as columns: nested names joined by points, `_ns` as `_s`."""
    columns: Document = {}
    for name, value in part.items():
        if isinstance(value, Mapping):
            columns |= flat_columns(value, f"{prefix}{name}.")
        elif name.endswith("_ns"):
            columns[f"{prefix}{name[:-3]}_s"] = None if value is None else value / 1e9
        else:
            columns[prefix + name] = value
    return columns


def _text(value: Any) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, str):
        return value
    return json.dumps(value, separators=(",", ":"))


def _arrow(name: str, values: Sequence[Any]) -> Any:
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    # A column of times has one type in every store, though nothing may have been found in this one.
    if name.endswith("_s") or (kinds <= {int, float} and float in kinds):
        return pa.array([None if value is None else float(value) for value in values], pa.float64())
    if kinds <= {bool} or kinds <= {int}:
        return pa.array(values)
    texts = [None if value is None else _text(value) for value in values]
    return pa.array(
        [None if text is None else text.encode(errors="backslashreplace") for text in texts]
    ).cast(pa.string())


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _without_nan(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

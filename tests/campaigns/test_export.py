"""Rows as files: the same figures in every format, the same bytes again, whole or not at all."""

import csv
import json
import math
import random

import pytest
from pyarrow import parquet

from campaigns.errors import CampaignError
from campaigns.export import document, flat, road_tables, write_csv, write_json, write_parquet
from tests.campaigns.synthetic import CAMPAIGN, Row, row

ROWS = [
    row("hold", "CD", 1, 0.43, "hold", parameters={"gain": 1.1, "motorcycle": "gsxr1000"}),
    row("hold", "MD", 2),
    row("fault-free", "OK", 3),
]


def write(kind, path, rows=ROWS):
    if kind == "json":
        write_json(path, document(CAMPAIGN, road_tables(rows), rows))
    elif kind == "csv":
        write_csv(path, rows)
    else:
        write_parquet(path, rows, CAMPAIGN)


KINDS = pytest.mark.parametrize("kind", ["json", "csv", "parquet"])


def test_flat():
    """A row's columns: nested names with points, times in seconds, nothing lost."""
    columns = flat(ROWS[0])
    assert columns["parameters.gain"] == 1.1
    assert columns["lap.seed"] == 1
    assert (columns["t_active_s"], columns["t_alarm_s"], columns["td_s"]) == (60.0, 60.43, 0.43)
    assert columns["t_heal_s"] is None
    assert columns["ecu.ecu"] == "ifd"


def test_csv(tmp_path):
    """The sheet begins with what one looks for; what did not happen is an empty cell."""
    write_csv(tmp_path / "out.csv", ROWS)
    with (tmp_path / "out.csv").open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert list(lines[0])[:4] == ["id", "condition", "parameters.gain", "parameters.motorcycle"]
    assert {line["id"]: line["td_s"] for line in lines} == {
        ROWS[0].id: "0.43",
        ROWS[1].id: "",
        ROWS[2].id: "",
    }
    assert [line["id"] for line in lines] == sorted(row.id for row in ROWS)


def test_parquet(tmp_path):
    """Parquet has the same columns with their types, null for what did not happen, and the campaign."""
    write_parquet(tmp_path / "out.parquet", ROWS, CAMPAIGN)
    table = parquet.read_table(tmp_path / "out.parquet")
    assert table.to_pylist() == [
        {name: flat(row).get(name) for name in table.column_names} for row in sorted(ROWS, key=lambda r: r.id)
    ]
    types = {field.name: str(field.type) for field in table.schema}
    assert (types["t_heal_s"], types["td_s"], types["lap.seed"], types["outcome"]) == (
        "double", "double", "int64", "string"
    )  # fmt: skip
    assert json.loads(table.schema.metadata[b"strokebench.campaign"]) == CAMPAIGN


def test_json(tmp_path):
    """The document has the campaign, the tables and every trial by its id."""
    write("json", tmp_path / "out.json")
    found = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert found["campaign"] == CAMPAIGN
    assert found["tables"] == json.loads(json.dumps(road_tables(ROWS)))
    assert [Row(**trial) for trial in found["trials"]] == sorted(ROWS, key=lambda row: row.id)


def test_no_nan(tmp_path):
    """What is no number becomes null in JSON, an empty cell in CSV."""
    rows = [row("hold", "MD", 1, parameters={"gain": math.nan}, bus_load=math.inf)]
    write("json", tmp_path / "out.json", rows)
    found = json.loads((tmp_path / "out.json").read_text(), parse_constant=pytest.fail)
    assert found["trials"][0]["trial"]["parameters"] == {"gain": None}
    write("csv", tmp_path / "out.csv", rows)
    assert "nan" not in (tmp_path / "out.csv").read_text()


@KINDS
def test_same_rows_same_bytes(tmp_path, kind):
    """The order in which trials were finished leaves no trace."""
    write(kind, tmp_path / "a", ROWS)
    write(kind, tmp_path / "b", random.sample(ROWS, len(ROWS)))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@KINDS
def test_of_no_row(tmp_path, kind):
    """A store in which nothing was finished can be exported."""
    write(kind, tmp_path / "out", [])
    assert (tmp_path / "out").stat().st_size > 0


@KINDS
def test_whole_or_not_at_all(tmp_path, kind):
    """A folder that is not there is one line; nothing is left behind."""
    with pytest.raises(CampaignError, match=r"nowhere/out: cannot be written: no such file or directory$"):
        write(kind, tmp_path / "nowhere" / "out")
    assert list(tmp_path.iterdir()) == []


@KINDS
def test_full_disk(tmp_path, kind, monkeypatch):
    """A file that cannot be finished leaves what was there before."""
    (tmp_path / "out").write_text("before")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_text", full)
    monkeypatch.setattr("pyarrow.parquet.write_table", full)
    with pytest.raises(CampaignError, match="no space left on device"):
        write(kind, tmp_path / "out")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"before"]


def test_other_documents(tmp_path):
    """Rows of other trials, with cells and lists in them, become columns as well."""
    rows = [Row("a" * 16, {"kind": "offline"}, {"t_fault_ns": 5_000_000, "cells": {"L50": [1, None]}})]
    write_csv(tmp_path / "out.csv", rows)
    assert (tmp_path / "out.csv").read_text() == (
        f'id,cells.L50,kind,t_fault_s\n{"a" * 16},"[1,null]",offline,0.005\n'
    )
    write_parquet(tmp_path / "out.parquet", rows)
    assert parquet.read_table(tmp_path / "out.parquet").to_pylist()[0]["cells.L50"] == "[1,null]"


def test_mixed_column(tmp_path):
    """A parameter that is a number in one trial and a word in another is text."""
    rows = [row("hold", "MD", 1, parameters={"load": 9}), row("hold", "MD", 2, parameters={"load": "two up"})]
    write_parquet(tmp_path / "out.parquet", rows)
    loads = parquet.read_table(tmp_path / "out.parquet").column("parameters.load").to_pylist()
    assert sorted(loads) == ["9", "two up"]

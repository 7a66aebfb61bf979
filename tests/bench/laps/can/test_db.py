"""python-can's SQLite log: a file that may carry programs, of which none is run."""

import sqlite3
from contextlib import closing

import pytest

from bench.errors import LapError
from bench.laps.can.db import COLUMNS, read
from tests.bench.laps.can.logs import FRAMES, strokes, write

PLAIN = (
    "CREATE TABLE messages (ts REAL, arbitration_id INTEGER, extended INTEGER, remote INTEGER, "
    "error INTEGER, dlc INTEGER, data BLOB)"
)
ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x FROM n"


def database(tmp_path, *statements):
    path = tmp_path / "ride.db"
    with closing(sqlite3.connect(path)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()
    return path


def row(*values):
    return f"INSERT INTO messages VALUES ({', '.join(values)})"


def test_reading_leaves_the_file_as_it_is(tmp_path):
    """The file is opened for reading only; nothing is written beside it."""
    path = write(tmp_path / "ride.db", strokes())
    before = path.read_bytes()
    path.chmod(0o444)
    assert len(read(path).tracks["fork_stroke_mm"].t_ns) == FRAMES
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["ride.db"]


def test_the_order_of_the_columns_does_not_matter(tmp_path):
    """Columns go by their names."""
    columns = ", ".join(reversed(COLUMNS))
    path = database(
        tmp_path,
        f"CREATE TABLE messages ({columns})",
        row("x'01000000'", "4", "0", "0", "0", "256", "0.5"),
        row("x'02000000'", "4", "0", "0", "0", "256", "1"),
    )
    assert read(path).tracks["fork_stroke_mm"].t_ns.tolist() == [500_000_000, 1_000_000_000]


@pytest.mark.parametrize(
    ("statements", "says"),
    [
        ([f"CREATE VIEW messages AS {ENDLESS}"], "no table messages in it"),
        (["CREATE TABLE other (x)"], "no table messages in it"),
        (["CREATE VIRTUAL TABLE messages USING fts5(ts)"], "no table messages in it"),
        (["CREATE TABLE messages (ts, data)"], "the table messages has ts, data, not ts, arbitration_id, "),
        ([PLAIN.replace("ts REAL", "ts REAL AS (abs(dlc))")], "the table messages has ts, arb"),
        (
            [PLAIN.replace("dlc INTEGER", "dlc INTEGER, more AS (hex(zeroblob(1000000))) STORED")],
            "the table messages has",
        ),
        ([PLAIN], "no CAN frame"),
        ([PLAIN, row("'now'", "256", "0", "0", "0", "4", "x'01020304'")], "row 1: .* are not all numbers"),
        ([PLAIN, row("0", "NULL", "0", "0", "0", "4", "x'01020304'")], "row 1: .* are not all numbers"),
        ([PLAIN, row("0", "256", "0", "0", "0", "4", "'text'")], "row 1: data 'text' are not bytes"),
        (
            [PLAIN, row("9e99", "256", "0", "0", "0", "4", "x'01020304'")],
            r"row 1: time 9e\+99 s is beyond any lap",
        ),
        (
            [PLAIN, row("0", "256", "0", "0", "0", "4", "x'0102'")],
            "row 1: 2 data bytes where the length is 4",
        ),
        ([PLAIN, row("0", "256", "0", "0", "0", "8", "zeroblob(1000000)")], "too big"),
    ],
)
def test_what_is_no_plain_table_of_frames_is_refused(tmp_path, statements, says):
    """Views, virtual tables, computed columns and values of other kinds are named, not evaluated."""
    with pytest.raises(LapError, match=says) as refusal:
        read(database(tmp_path, *statements))
    assert "\n" not in str(refusal.value)


def test_a_check_is_not_evaluated(tmp_path):
    """A constraint that comes with the file is not asked for its opinion."""
    check = PLAIN.replace("data BLOB", "data BLOB CHECK (length(hex(zeroblob(400000000))) > 0)")
    path = database(
        tmp_path,
        "PRAGMA ignore_check_constraints = ON",
        check,
        row("0", "256", "0", "0", "0", "4", "x'01020304'"),
    )
    assert len(read(path).tracks["fork_stroke_mm"].t_ns) == 1


@pytest.mark.parametrize("left", ["ride.db-journal", "ride.db-wal"])
def test_a_database_that_was_not_closed_is_refused(tmp_path, left):
    """What still lies in a journal beside the file would be missing from the ride."""
    path = write(tmp_path / "ride.db", strokes())
    (tmp_path / left).write_bytes(b"pages")
    with pytest.raises(LapError, match=f"was not closed: {left} holds part of it"):
        read(path)


def test_pages_in_a_circle_are_refused(tmp_path):
    """A table whose pages lead back to themselves is found damaged before it is read."""
    messages = strokes() * 40
    path = write(tmp_path / "ride.db", messages)
    content = bytearray(path.read_bytes())
    size = int.from_bytes(content[16:18], "big")
    root = next(at for at in range(size, len(content), size) if content[at] == 5)  # an interior page
    content[root + 8 : root + 12] = (root // size + 1).to_bytes(4, "big")
    path.write_bytes(content)
    with pytest.raises(LapError, match=r"ride\.db: (damaged|not a sound)"):
        read(path)

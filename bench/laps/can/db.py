"""CAN logs in python-can's SQLite database, .db: the table `messages`.

Belongs here: how to read a table from a file that nobody vouches for. Never: a signal. It names no bus.

Not through python-can's reader, which opens the file for writing and asks a view as readily as a table: a
view, a trigger or a computed column is a program that comes with the file.
"""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from bench.errors import LapError
from bench.laps.can import log as can_log
from bench.laps.can.frames import MOST_BYTES, Damage, gather
from bench.laps.channel_map import ChannelMap
from bench.laps.recording import Recording

if TYPE_CHECKING:
    import can

COLUMNS = ("ts", "arbitration_id", "extended", "remote", "error", "dlc", "data")
LONGEST_CELL = 100_000
"""Bytes; the text that makes the table is one of them."""


def read(path: Path, channel_map: ChannelMap | None = None) -> Recording:
    """Read a log through the map's DBC; times as they stand in it. The file is not written to.

    Raises LapError for what is no database, is damaged, or was not closed.
    """
    if path.stat().st_size > MOST_BYTES:
        raise LapError(f"{path}: longer than {MOST_BYTES} bytes: cut it to the lap")
    for left in (path.with_name(path.name + "-journal"), path.with_name(path.name + "-wal")):
        if left.exists() and left.stat().st_size:
            raise LapError(
                f"{path}: was not closed: {left.name} holds part of it; open and close it in sqlite3"
            )
    try:
        with closing(_open(path)) as connection:
            frames = gather(_messages(connection, str(path)), Damage(str(path), "row"))
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise LapError(f"{path}: not a sound SQLite database: {' '.join(str(error).split())}") from None
    return can_log.recording(path, frames, channel_map)


def _open(path: Path) -> sqlite3.Connection:
    """The database, read only, after a look whether `messages` is a plain and sound table."""
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_CELL)
        for pragma in ("trusted_schema = OFF", "ignore_check_constraints = ON", "cell_size_check = ON"):
            connection.execute(f"PRAGMA {pragma}")
        kinds = connection.execute("SELECT type, rootpage FROM sqlite_master WHERE lower(name) = 'messages'")
        if [bool(kind == "table" and page) for kind, page in kinds.fetchall()] != [True]:
            raise LapError(f"{path}: no table messages in it; python-can's SqliteWriter makes one")
        columns = {row[1]: row[6] for row in connection.execute("PRAGMA table_xinfo(messages)")}
        if any(columns.values()) or not set(COLUMNS) <= set(columns):
            raise LapError(f"{path}: the table messages has {', '.join(columns)}, not {', '.join(COLUMNS)}")
        # pages that lead to each other would be read for ever
        problem = connection.execute("PRAGMA quick_check(messages)").fetchone()[0]
        if problem != "ok":
            raise LapError(f"{path}: damaged: {' '.join(str(problem).split())}")
    except BaseException:
        connection.close()
        raise
    return connection


def _messages(connection: sqlite3.Connection, where: str) -> "Iterator[tuple[int, can.Message]]":
    import can

    rows = connection.execute(f"SELECT {', '.join(COLUMNS)} FROM messages")
    for at, (t_s, identifier, extended, remote, error, dlc, data) in enumerate(rows, 1):
        numbers = (identifier, extended, remote, error, dlc)
        if not isinstance(t_s, int | float) or not all(isinstance(number, int) for number in numbers):
            raise LapError(f"{where}: row {at}: {(t_s, *numbers)!r:.80} are not all numbers")
        if not isinstance(data, bytes | None):
            raise LapError(f"{where}: row {at}: data {data!r:.40} are not bytes")
        yield (
            at,
            can.Message(
                timestamp=t_s,
                arbitration_id=identifier,
                is_extended_id=bool(extended),
                is_remote_frame=bool(remote),
                is_error_frame=bool(error),
                dlc=dlc,
                data=data,
            ),
        )

"""A campaign's store: one SQLite file of finished trials, from which an interrupted run goes on.

Belongs here: what a store holds, and every reason why it cannot. Never: what a trial is, which come next.

Each trial is a transaction of its own in a write-ahead log, so that kill -9 at any moment loses none that was
finished. A store that was closed is a single file that anybody may read from anywhere.
"""

import json
import shutil
import sqlite3
import tempfile
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from bench.whole import check_writable
from campaigns.errors import CampaignError
from campaigns.lock import Lock

FORMAT, VERSION = "strokebench campaign", 1
"""What the file calls itself. The version counts up with every change of a table or of a document in it."""

_MAGIC = b"SQLite format 3\0"
_TABLES = (
    "CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID",
    "CREATE TABLE trials (id TEXT PRIMARY KEY, trial TEXT NOT NULL, result TEXT NOT NULL, frame BLOB)",
)

Document = dict[str, Any]


def canonical(document: Any) -> str:
    """The one JSON text of a document, whatever the order of its keys."""
    return json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def trial_id(trial: Mapping[str, Any]) -> str:
    """Derived from the content: the same trial has the same id in every campaign."""
    return sha256(canonical(trial).encode()).hexdigest()[:16]


class Identified(ABC):
    """What is known by all that decides it."""

    @abstractmethod
    def document(self) -> Document:
        """All that decides the result, and nothing else."""

    @property
    def id(self) -> str:
        """Derived from the content: the same trial has the same id in every campaign."""
        return trial_id(self.document())


@dataclass(frozen=True)
class Row:
    """A finished trial."""

    id: str
    trial: Document
    result: Document


class Store:
    """Finished trials of one campaign; a context manager. Every refusal is a CampaignError, one line."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self.campaign: Document = {}
        self._connection = connection
        self._lock: Lock | None = None
        self._new = False
        self._copy: tempfile.TemporaryDirectory[str] | None = None

    @classmethod
    def open(cls, path: Path, campaign: Mapping[str, Any]) -> Self:
        """The store at `path` to go on with, or a new one; nobody else can open it until it is closed."""
        path = Path(path)
        check_writable(path, CampaignError)
        _check_kind(path)
        lock, new = Lock(path), not path.exists()
        try:
            with _told(path):
                store = cls(path, sqlite3.connect(path, isolation_level=None))
        except BaseException:
            lock.release()
            raise
        store._lock, store._new = lock, new
        try:
            store._begin(campaign)
        except BaseException:
            store._close(discard=new)
            raise
        return store

    @classmethod
    def read(cls, path: Path) -> Self:
        """The store at `path`, whatever its campaign, also while a run writes to it."""
        path = Path(path)
        if not path.exists():
            raise CampaignError(f"{path}: no such file")
        _check_kind(path)
        with _told(path):
            # as_uri() for a name may hold what means something in an address
            store = cls(path, sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True))
        try:
            with _told(path):
                try:
                    known = store._tables()
                except sqlite3.OperationalError as problem:
                    # A killed run left its log, and SQLite cannot write the index that belongs to it.
                    if _primary(problem) not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY):
                        raise
                    store._read_copy()
                    known = store._tables()
            if not known:
                raise CampaignError(f"{path}: holds no campaign")
            store._check_format(known)
        except BaseException:
            store.close()
            raise
        return store

    def ids(self) -> set[str]:
        """Of the finished trials."""
        with _told(self.path):
            return {id for (id,) in self._connection.execute("SELECT id FROM trials")}

    def put(self, id: str, trial: Mapping[str, Any], result: Mapping[str, Any], frame: Any | None) -> None:
        """Keep a finished trial; when this returns it is not lost any more. ValueError if it is in."""
        packed = None if frame is None else zlib.compress(canonical(frame).encode())
        row = (id, canonical(trial), canonical(result), packed)
        try:
            with _told(self.path):
                self._connection.execute("INSERT INTO trials VALUES (?, ?, ?, ?)", row)
        except sqlite3.IntegrityError:
            raise ValueError(f"{self.path}: trial {id} is in it already") from None

    def rows(self) -> Iterator[Row]:
        """The finished trials, ordered by id."""
        with _told(self.path):
            for id, trial, result in self._connection.execute(
                "SELECT id, trial, result FROM trials ORDER BY id"
            ):
                yield self._row(id, trial, result)

    def row(self, id: str) -> Row | None:
        """The finished trial of that id."""
        with _told(self.path):
            found = self._connection.execute("SELECT id, trial, result FROM trials WHERE id = ?", (id,))
            row = found.fetchone()
        return None if row is None else self._row(*row)

    def frame(self, id: str) -> Document | None:
        """The freeze frame of that trial; None where it has none."""
        with _told(self.path):
            found = self._connection.execute("SELECT frame FROM trials WHERE id = ?", (id,)).fetchone()
        if found is None or found[0] is None:
            return None
        frame: Document = self._parsed(self._unpacked(id, found[0]), f"freeze frame of trial {id}")
        return frame

    def content_hash(self) -> str:
        """SHA-256 of everything in it: equal for equal content, whoever wrote it and in whatever order."""
        total = sha256(canonical(self.campaign).encode())
        with _told(self.path):
            for id, trial, result, frame in self._connection.execute(
                "SELECT id, trial, result, frame FROM trials ORDER BY id"
            ):
                # No newline is in any of them: canonical JSON writes it as \n.
                shown = "" if frame is None else self._unpacked(id, frame)
                total.update("\n".join(("", id, trial, result, shown)).encode())
        return total.hexdigest()

    def close(self) -> None:
        """Leave one file, which no reader needs a log beside."""
        self._close()

    def _close(self, discard: bool = False) -> None:
        lock, self._lock = self._lock, None
        if lock:
            try:
                self._connection.execute("PRAGMA busy_timeout = 0")
                self._connection.execute("PRAGMA journal_mode = DELETE")
            except sqlite3.Error:
                pass  # a reader has it open, or the disk is full: the log stays, with all that is in it
        self._connection.close()
        if discard:
            for path in _files(self.path):
                path.unlink(missing_ok=True)
        if lock:
            lock.release()
        if self._copy:
            self._copy.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        discard = False
        if self._new and self._lock and error is not None:
            with suppress(CampaignError):
                discard = not self.ids()  # what failed before its first trial leaves no empty store behind
        self._close(discard)

    def _begin(self, campaign: Mapping[str, Any]) -> None:
        text = canonical(campaign)
        with _told(self.path):
            known = self._tables()
        if known:
            self._check_format(known)
            here = json.loads(text)
            if self.campaign != here:
                raise CampaignError(
                    f"{self.path}: is the store of another campaign: {_difference(self.campaign, here)}"
                )
        with _told(self.path):
            # NORMAL: no commit waits for the disk. After kill -9 the system still has them all; after a power
            # cut the newest may be gone, whole, and are run again to the same results. FULL would keep these
            # too, at some ms a trial: more than a quick trial itself takes.
            self._connection.execute("PRAGMA synchronous = NORMAL")
            self._connection.execute("PRAGMA journal_mode = WAL")
            if known:
                return
            meta = {"format": FORMAT, "version": str(VERSION), "campaign": text}
            self._connection.execute("BEGIN IMMEDIATE")
            for table in _TABLES:
                self._connection.execute(table)
            self._connection.executemany("INSERT INTO meta VALUES (?, ?)", meta.items())
            self._connection.execute("COMMIT")
        self.campaign = json.loads(text)

    def _tables(self) -> set[str]:
        return {name for (name,) in self._connection.execute("SELECT name FROM sqlite_master")}

    def _check_format(self, known: set[str]) -> None:
        """Read `campaign`, if this is a store of ours and of this version."""
        meta: dict[str, str] = {}
        if {"meta", "trials"} <= known:
            with _told(self.path):
                meta = dict(self._connection.execute("SELECT * FROM meta").fetchall())
        if meta.get("format") != FORMAT:
            raise CampaignError(f"{self.path}: is no store of a campaign")
        if meta.get("version") != str(VERSION):
            raise CampaignError(
                f"{self.path}: is a store of version {meta.get('version')}; this is version {VERSION}"
            )
        self.campaign = self._parsed(meta.get("campaign", ""), "campaign")

    def _read_copy(self) -> None:
        self._connection.close()
        self._copy = tempfile.TemporaryDirectory(prefix="strokebench-store-")
        try:
            file, log, _ = _files(self.path)
            shutil.copyfile(file, Path(self._copy.name) / "store")
            if log.exists():
                shutil.copyfile(log, Path(self._copy.name) / "store-wal")
        except OSError as problem:
            raise CampaignError(f"{self.path}: cannot be copied to be read: {problem.strerror}") from None
        self._connection = sqlite3.connect(Path(self._copy.name) / "store")

    def _row(self, id: str, trial: str, result: str) -> Row:
        document = self._parsed(trial, f"trial {id}")
        if trial_id(document) != id:
            raise CampaignError(f"{self.path}: is damaged: trial {id} is not what its id was derived from")
        return Row(id, document, self._parsed(result, f"result of trial {id}"))

    def _parsed(self, text: str, what: str) -> Document:
        try:
            document = json.loads(text, parse_constant=_no_number)
        except (ValueError, TypeError, RecursionError):
            document = None
        if not isinstance(document, dict):
            raise CampaignError(f"{self.path}: is damaged: the {what} is no document")
        return document

    def _unpacked(self, id: str, frame: bytes) -> str:
        try:
            return zlib.decompress(frame).decode()
        except (zlib.error, ValueError, TypeError):
            raise CampaignError(
                f"{self.path}: is damaged: the freeze frame of trial {id} cannot be unpacked"
            ) from None


def _no_number(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def _check_kind(path: Path) -> None:
    """Refuse what is no SQLite file before SQLite touches it. An empty one is a run killed at its start."""
    try:
        if path.exists() and not path.is_file():
            raise CampaignError(f"{path}: is no file")
        if path.exists():
            with path.open("rb") as file:
                begin = file.read(len(_MAGIC))
            if begin not in (b"", _MAGIC):
                raise CampaignError(f"{path}: is no store of a campaign")
    except OSError as problem:
        raise CampaignError(f"{path}: cannot be read: {(problem.strerror or str(problem)).lower()}") from None


def _files(path: Path) -> tuple[Path, ...]:
    """The store, its log and the log's index."""
    return path, path.with_name(f"{path.name}-wal"), path.with_name(f"{path.name}-shm")


def _primary(problem: Exception) -> int:
    code: int = getattr(problem, "sqlite_errorcode", sqlite3.SQLITE_ERROR)
    return code & 0xFF


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """What SQLite refuses, as one line about `path`."""
    try:
        yield
    except (sqlite3.IntegrityError, sqlite3.ProgrammingError):  # mistakes of ours, not the file's
        raise
    except (sqlite3.DatabaseError, UnicodeDecodeError) as problem:
        raise CampaignError(f"{path}: {_reason(path, problem)}") from None


def _reason(path: Path, problem: Exception) -> str:
    if not hasattr(problem, "sqlite_errorcode"):  # Python's own: a text, or a table's name, that is not UTF-8
        return "is damaged: it holds what is no text"
    code = _primary(problem)
    # Where the log's index cannot grow, SQLite calls it an I/O error.
    full = code == sqlite3.SQLITE_IOERR and shutil.disk_usage(path.parent).free < 1 << 16
    if code == sqlite3.SQLITE_FULL or full:
        return "the disk is full; the trials that are finished are kept"
    words = {
        sqlite3.SQLITE_READONLY: "cannot be written: it or its folder is read-only",
        sqlite3.SQLITE_CANTOPEN: "cannot be opened, or its folder is read-only",
        sqlite3.SQLITE_BUSY: "is in use by another program",
        sqlite3.SQLITE_NOTADB: "is no store of a campaign",
        sqlite3.SQLITE_CORRUPT: "is damaged",
    }
    return words.get(code, f"cannot be read or written: {problem}")


def _difference(there: Any, here: Any, at: str = "") -> str:
    """The first key path at which two documents differ, and both values."""
    if isinstance(there, dict) and isinstance(here, dict):
        for key in sorted({*there, *here}):
            path = f"{at}.{key}" if at else str(key)
            if key not in there or key not in here or there[key] != here[key]:
                return _difference(there.get(key, _ABSENT), here.get(key, _ABSENT), path)
    if isinstance(there, list) and isinstance(here, list) and len(there) == len(here):
        for k, (one, other) in enumerate(zip(there, here, strict=True)):
            if one != other:
                return _difference(one, other, f"{at}[{k}]")
    return f"{at} is {_short(there)} in it, {_short(here)} now"


_ABSENT = object()


def _short(value: Any) -> str:
    text = "absent" if value is _ABSENT else canonical(value)
    return text if len(text) <= 40 else f"{text[:37]}..."

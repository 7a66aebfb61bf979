"""A campaign's store: what it gives back, and everything for which it is refused in one line."""

import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from campaigns.errors import CampaignError
from campaigns.store import VERSION, Row, Store, canonical, trial_id
from tests.campaigns.trifles import environment

CAMPAIGN = {"name": "road", "plan": {"laps": 3, "faults": ["open", "short"]}, "versions": {"numpy": "2.0"}}
TRIALS = [{"kind": "road", "n": n, "lap": {"route": "über\nLand"}} for n in range(5)]


def result(n):
    return {"outcome": "CD", "squares": 10**30 + n, "bus_load": 0.1 + n}


def frame(n):
    return {"t0_ns": n, "measured_mm": [0.1 * k for k in range(50)]} if n % 2 else None


def fill(store, numbers=range(5)):
    for n in numbers:
        store.put(trial_id(TRIALS[n]), TRIALS[n], result(n), frame(n))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a store?.db"


@pytest.fixture
def filled(path):
    with Store.open(path, CAMPAIGN) as store:
        fill(store)
    return path


def edit(path, *statements):
    with closing(sqlite3.connect(path)) as connection, connection:
        for statement, *values in statements:
            connection.execute(statement, values)


def refused(path, campaign=CAMPAIGN, read=False):
    """The one line with which it is not opened; nothing beside it, and nothing in it, changes."""
    before = {file: file.read_bytes() for file in path.parent.iterdir() if file.is_file()}
    with pytest.raises(CampaignError) as refusal:
        (Store.read(path) if read else Store.open(path, campaign)).close()
    assert {file: file.read_bytes() for file in path.parent.iterdir() if file.is_file()} == before
    line = str(refusal.value)
    assert line.startswith(f"{path}: ")
    assert "\n" not in line
    return line.removeprefix(f"{path}: ")


@contextmanager
def another_than_root():
    """Root may write everything: become another user."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@contextmanager
def readable_only(folder):
    """As somebody who may write nothing in `folder`."""
    folder.chmod(0o555)
    for file in folder.iterdir():
        file.chmod(0o444)
    try:
        with another_than_root():
            yield
    finally:
        folder.chmod(0o755)


@pytest.fixture
def open_folder():
    """A folder that other users may enter, as pytest's own is not."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        yield Path(name)


def kill_while_writing(path):
    """Leave a store as kill -9 leaves it: a log beside it, with all trials in it."""
    script = (
        "import os, sys; from tests.campaigns.test_store import *\n"
        "store = Store.open(Path(sys.argv[1]), CAMPAIGN); fill(store); os.kill(os.getpid(), 9)"
    )
    root = str(Path(__file__).parents[2])
    env = environment()
    env["PYTHONPATH"] = os.pathsep.join([env["PYTHONPATH"], root])
    assert subprocess.run([sys.executable, "-c", script, str(path)], env=env, check=False).returncode == -9


def test_gives_back(filled):
    """What was put is given back, ordered by id; what was not is not there."""
    with Store.read(filled) as store:
        ids = [trial_id(trial) for trial in TRIALS]
        assert store.campaign == CAMPAIGN
        assert store.ids() == set(ids)
        rows = {id: Row(id, TRIALS[n], result(n)) for n, id in enumerate(ids)}
        assert list(store.rows()) == [rows[id] for id in sorted(ids)]
        for n, id in enumerate(ids):
            assert (store.row(id), store.frame(id)) == (rows[id], frame(n))
        assert store.row("0" * 16) is store.frame("0" * 16) is None


def test_one_file(filled):
    """A closed store is one file, with neither a log nor a lock beside it."""
    assert list(filled.parent.iterdir()) == [filled]
    with Store.read(filled) as store:
        store.content_hash()
    assert list(filled.parent.iterdir()) == [filled]


def test_go_on(path):
    """A store is opened again by its own campaign, whatever the order of the keys, and goes on."""
    with Store.open(path, CAMPAIGN) as store:
        fill(store, [0, 1])
    with Store.open(path, dict(reversed(CAMPAIGN.items()))) as store:
        assert len(store.ids()) == 2
        fill(store, [2])
        assert len(store.ids()) == 3


def test_content_hash(path, tmp_path):
    """Equal content hashes equally, in whatever order and however often interrupted it was written."""
    other = tmp_path / "other"
    with Store.open(path, CAMPAIGN) as store:
        fill(store)
        expected = store.content_hash()
    for numbers in ([4, 2], [3, 0, 1]):
        with Store.open(other, CAMPAIGN) as store:
            fill(store, numbers)
    edit(other, ("CREATE TABLE filler (x)",), ("DROP TABLE filler",))
    assert path.read_bytes() != other.read_bytes()
    with Store.read(other) as store:
        assert store.content_hash() == expected


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE trials SET id = 'a' || id",
        "UPDATE trials SET trial = '{}' WHERE rowid = 1",
        "UPDATE trials SET result = '{}' WHERE rowid = 1",
        "UPDATE trials SET frame = NULL",
        "DELETE FROM trials WHERE rowid = 1",
        """UPDATE meta SET value = '{"name":"x"}' WHERE key = 'campaign'""",
    ],
)
def test_other_content_hash(filled, change):
    """Whatever is in a store is in its hash."""
    with Store.read(filled) as store:
        before = store.content_hash()
    edit(filled, (change,))
    with Store.read(filled) as store:
        assert store.content_hash() != before


def test_twice(path):
    """A trial is put once."""
    with Store.open(path, CAMPAIGN) as store:
        fill(store, [1])
        with pytest.raises(ValueError, match="is in it already"):
            fill(store, [1])


def test_no_nan(path):
    """What is no JSON number is not stored."""
    with Store.open(path, CAMPAIGN) as store:
        with pytest.raises(ValueError, match="JSON compliant"):
            store.put("a", {}, {"x": float("nan")}, None)
        assert store.ids() == set()


def test_killed(path):
    """After kill -9 every trial put is there, to be read and to be gone on with."""
    kill_while_writing(path)
    assert path.with_name(f"{path.name}-wal").exists()
    with Store.read(path) as store:
        found = store.content_hash()
    with Store.open(path, CAMPAIGN) as store:
        assert store.content_hash() == found
        assert len(store.ids()) == 5
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("index", [True, False])
def test_killed_and_read_only(open_folder, index):
    """What a killed run left is read where nothing may be written, with or without the log's index."""
    path = open_folder / "store"
    kill_while_writing(path)
    if not index:
        path.with_name("store-shm").unlink()
    with readable_only(open_folder), Store.read(path) as store:
        assert len(store.ids()) == 5
        assert store.frame(trial_id(TRIALS[1])) == frame(1)


def test_read_only(open_folder):
    """A finished store is read where nothing may be written, and not opened there."""
    path = open_folder / "store"
    with Store.open(path, CAMPAIGN) as store:
        fill(store)
    with readable_only(open_folder):
        # the second where it is root that has become another user: os.access asks about root
        assert refused(path) in (
            f"folder {open_folder} is not writable",
            f"cannot be locked for writing ({path}.lock): permission denied",
        )
        with Store.read(path) as store:
            assert len(store.ids()) == 5


def test_read_only_file(open_folder):
    """A file that may not be written in a folder that may is refused, and no lock is left."""
    path = open_folder / "store"
    with Store.open(path, CAMPAIGN):
        pass
    path.chmod(0o444)
    os.chown(open_folder, *((65534, 65534) if os.geteuid() == 0 else (-1, -1)))
    with another_than_root():
        assert refused(path) == "cannot be written: it or its folder is read-only"


def test_read_while_written(path):
    """A store is read while a run writes to it, and that goes on, and closes, in the reader's presence."""
    with Store.open(path, CAMPAIGN) as store:
        fill(store, [0])
        with Store.read(path) as reader:
            assert len(reader.ids()) == 1
            fill(store, [1])
            assert len(reader.ids()) == 2
            rows = reader.rows()
            next(rows)
            store.close()
    with Store.read(path) as store:
        assert len(store.ids()) == 2


def test_two_writers(path):
    """Two runs at once on one store do not both run, and the first one is not disturbed."""
    with Store.open(path, CAMPAIGN) as store:
        link = path.with_name("link")
        link.symlink_to(path)
        for name in (path, link):
            with pytest.raises(CampaignError, match="another run is writing to it"):
                Store.open(name, CAMPAIGN)
        fill(store)
    with Store.open(path, CAMPAIGN) as store:
        assert len(store.ids()) == 5


def test_left_lock(path):
    """The lock file of a run that was killed locks nothing."""
    path.with_name(f"{path.name}.lock").touch()
    with Store.open(path, CAMPAIGN):
        pass
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    ("other", "difference"),
    [
        ({"name": "demo"}, 'name is "road" in it, "demo" now'),
        ({"plan": {"laps": 4, "faults": []}}, 'plan.faults is ["open","short"] in it, [] now'),
        ({"plan": {"laps": 3, "faults": ["open", "hold"]}}, 'plan.faults[1] is "short" in it, "hold" now'),
        ({"versions": {"numpy": "2.0", "numba": "1"}}, 'versions.numba is absent in it, "1" now'),
        ({"laps": ["x" * 99]}, f'laps is absent in it, ["{"x" * 35}... now'),
    ],
)
def test_other_campaign(filled, other, difference):
    """The store of another campaign is refused with the first key that differs and both values."""
    assert refused(filled, {**CAMPAIGN, **other}) == f"is the store of another campaign: {difference}"


@pytest.mark.parametrize("read", [True, False])
def test_other_version(filled, read):
    """A store of another format version is refused with both versions."""
    edit(filled, ("UPDATE meta SET value = '7' WHERE key = 'version'",))
    assert refused(filled, read=read) == f"is a store of version 7; this is version {VERSION}"


@pytest.mark.parametrize("read", [True, False])
@pytest.mark.parametrize("content", [b"# laps\n" * 9, b"SQLite format 3\0" + bytes(200), "database"])
def test_no_store(path, read, content):
    """What is no store is refused, and not touched."""
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        edit(path, ("CREATE TABLE meta (a, b)",), ("CREATE TABLE trials (a)",))
    assert refused(path, read=read) in ("is no store of a campaign", "is damaged")


def test_nothing_yet(path):
    """An empty file is one whose run was killed at its start: no campaign to read, but one may begin."""
    path.touch()
    assert refused(path, read=True) == "holds no campaign"
    with Store.open(path, CAMPAIGN) as store:
        assert store.ids() == set()


def test_no_file(path):
    """What is not there, or is no file, is refused."""
    assert refused(path, read=True) == "no such file"
    path.mkdir()
    assert refused(path, read=True) == "is no file"
    assert refused(path) == "is a folder"
    with pytest.raises(CampaignError, match="no folder"):
        Store.open(path / "deeper" / "store", CAMPAIGN)


@pytest.mark.parametrize("read", [True, False])
def test_damaged_file(filled, read):
    """A file with a damaged page is refused."""
    content = bytearray(filled.read_bytes())
    content[100:400] = b"\xff" * 300
    filled.write_bytes(content)
    assert refused(filled, read=read) == "is damaged"


def test_cut_off(filled):
    """A file that is cut off is refused when what is missing is asked for."""
    with filled.open("r+b") as file:
        file.truncate(filled.stat().st_size - 8192)
    with pytest.raises(CampaignError, match="is damaged"), Store.read(filled) as store:
        store.content_hash()


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("frame = x'00ff'", "the freeze frame of trial [0-9a-f]{16} cannot be unpacked"),
        ("result = cast(x'ff' AS TEXT)", "it holds what is no text"),
        ("frame = 'text'", "the freeze frame of trial [0-9a-f]{16} cannot be unpacked"),
        ("frame = x'789c030000000001'", "the freeze frame of trial [0-9a-f]{16} is no document"),
        ("trial = '[1]'", "the trial [0-9a-f]{16} is no document"),
        ("result = '{'", "the result of trial [0-9a-f]{16} is no document"),
        ("result = x'ff'", "the result of trial [0-9a-f]{16} is no document"),
    ],
)
def test_damaged_row(filled, change, what):
    """A row that is not what was put is refused with its trial."""
    edit(filled, (f"UPDATE trials SET {change}",))
    with Store.read(filled) as store:
        id = trial_id(TRIALS[1])
        with pytest.raises(CampaignError, match=f"is damaged: {what}"):
            (store.row(id), store.frame(id))


def test_full_disk(path):
    """On a full disk the trial that does not fit is refused, those before it are kept."""
    with Store.open(path, CAMPAIGN) as store:
        fill(store, [0, 1])
        pages = store._connection.execute("PRAGMA page_count").fetchone()[0]
        store._connection.execute(f"PRAGMA max_page_count = {pages}")  # as SQLite sees a full disk
        with pytest.raises(CampaignError, match="the disk is full; the trials that are finished are kept"):
            store.put("ab", {}, {"x": "y" * 100_000}, None)
    with Store.open(path, CAMPAIGN) as store:
        assert len(store.ids()) == 2
        store.put("ab", {}, {"x": "y" * 100_000}, None)


def test_refused_at_its_beginning(path):
    """A store that could not begin is not left behind."""
    with pytest.raises(ValueError, match="JSON compliant"):
        Store.open(path, {"x": float("inf")})
    assert list(path.parent.iterdir()) == []


def test_canonical():
    """A document has one text, whatever the order of its keys, and an id derived from it."""
    document = {"b": [1, 2.5, None], "a": "ü"}
    assert canonical(document) == '{"a":"ü","b":[1,2.5,null]}'
    assert trial_id(document) == trial_id(dict(reversed(document.items())))
    assert trial_id({}) == "44136fa355b3678a"


def test_moved(filled, tmp_path):
    """A closed store is its one file, wherever that is copied to."""
    with Store.read(filled) as store:
        expected = store.content_hash()
    copy = shutil.copy(filled, tmp_path / "copy")
    filled.unlink()
    with Store.read(Path(copy)) as store:
        assert store.content_hash() == expected


def test_new_store_of_a_run_that_failed_at_once(path):
    """A new store whose run fails before its first trial leaves no file; with a trial in it, it stays."""
    with pytest.raises(RuntimeError), Store.open(path, CAMPAIGN):
        raise RuntimeError
    assert list(path.parent.iterdir()) == []
    with pytest.raises(ValueError, match="is in it already"), Store.open(path, CAMPAIGN) as store:
        fill(store, [0, 0])
    with Store.read(path) as store:
        assert len(store.ids()) == 1

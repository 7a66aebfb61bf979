"""A campaign's store: what it gives back, killed, read-only, while it is written to, on a full disk."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest

from campaigns.errors import CampaignError
from campaigns.store import Row, Store, canonical, trial_id
from tests.campaigns.stores import (
    CAMPAIGN,
    TRIALS,
    another_than_root,
    edit,
    fill,
    frame,
    kill_while_writing,
    readable_only,
    refused,
    result,
)


@pytest.fixture
def open_folder():
    """A folder that other users may enter, as pytest's own is not."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        yield Path(name)


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

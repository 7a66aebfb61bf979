"""What is no store of this campaign and version, or a damaged one, is refused in one line and not touched."""

import pytest

from campaigns.errors import CampaignError
from campaigns.store import VERSION, Store, trial_id
from tests.campaigns.stores import CAMPAIGN, TRIALS, edit, refused


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


def test_damaged_names(filled):
    """A file whose tables have names that are no text is refused."""
    filled.write_bytes(filled.read_bytes().replace(b"trials", b"tri\xffls"))
    assert refused(filled, read=True) == "is damaged: it holds what is no text"


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
        ("trial = '{}'", "trial [0-9a-f]{16} is not what its id was derived from"),
        ("result = '{\"a\":NaN}'", "the result of trial [0-9a-f]{16} is no document"),
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


def test_refused_at_its_beginning(path):
    """A store that could not begin is not left behind."""
    with pytest.raises(ValueError, match="JSON compliant"):
        Store.open(path, {"x": float("inf")})
    assert list(path.parent.iterdir()) == []

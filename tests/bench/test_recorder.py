"""The recorder: every format reads back, carries no time of day, and is whole or absent."""

import datetime
import time
from importlib.util import find_spec

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.errors import RecordError
from bench.recorder import check_target, record
from targets.ecu import Frame

MDF = pytest.param(
    ".mf4", marks=pytest.mark.skipif(find_spec("asammdf") is None, reason="asammdf is not installed")
)
EACH = pytest.mark.parametrize("suffix", [".log", ".asc", ".blf", MDF])

ROWS = [
    (5_000_232_000, Frame(0x100, b"\x01\x02\x03\x04"), "MDLOG"),
    (5_000_232_000, Frame(0x7FF, b""), "IFD"),
    (6_000_000_001, Frame(0x1ABCDEF0, bytes(range(8)), True), "IFD"),
]


def read(path):
    with can.LogReader(path) as reader:
        return list(reader)


@EACH
def test_reads_back(tmp_path, suffix):
    """A recording reads back with its identifiers, data, sender's side and times from bus time 0."""
    path = tmp_path / f"run{suffix}"
    record(path, ROWS)
    messages = read(path)
    assert [(m.arbitration_id, bytes(m.data), m.is_extended_id) for m in messages] == [
        (frame.id, frame.data, frame.extended) for _, frame, _ in ROWS
    ]
    assert [m.is_rx for m in messages] == [False, True, True]
    assert [m.timestamp for m in messages] == pytest.approx([t / 1e9 for t, _, _ in ROWS], rel=0, abs=0.6e-6)


@settings(max_examples=25)
@given(st.lists(st.integers(0, 10**13), min_size=1, max_size=50))
def test_blf_keeps_nanoseconds(tmp_path_factory, instants):
    """A .blf recording keeps every instant to the nanosecond."""
    path = tmp_path_factory.mktemp("blf") / "run.blf"
    instants.sort()
    record(path, [(t_ns, Frame(0x100, b"\x00"), "IFD") for t_ns in instants])
    assert [round(m.timestamp * 1e9) for m in read(path)] == instants


@EACH
def test_no_time_of_day(tmp_path, monkeypatch, suffix):
    """The same frames give the same bytes at any time of day and in any time zone."""
    first, second = tmp_path / f"one{suffix}", tmp_path / f"two{suffix}"
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    record(first, ROWS)
    monkeypatch.setenv("TZ", "America/New_York")
    time.tzset()
    monkeypatch.setattr(time, "time", lambda: 2e9)
    later = type(
        "Later", (datetime.datetime,), {"now": classmethod(lambda cls, tz=None: cls(2033, 1, 1, tzinfo=tz))}
    )
    monkeypatch.setattr("can.io.asc.datetime", later)
    record(second, ROWS)
    monkeypatch.undo()
    time.tzset()
    assert first.read_bytes() == second.read_bytes()


@EACH
def test_nothing_recorded(tmp_path, suffix):
    """A run without a frame gives a file without a frame."""
    path = tmp_path / f"run{suffix}"
    record(path, [])
    assert read(path) == []


def test_candump_names_the_channel(tmp_path):
    """A candump log is what `candump -L vcan0` writes, from 0 s."""
    path = tmp_path / "run.log"
    record(path, [(10_000_000, Frame(0x100, b"\xab\xcd"), "IFD")])
    assert path.read_bytes() == b"(0.010000) vcan0 100#ABCD R\n"


REFUSALS = pytest.mark.parametrize(
    "act", [check_target, lambda path: record(path, ROWS)], ids=["check", "do"]
)


@REFUSALS
@pytest.mark.parametrize("name", ["run.csv", "run", "run.log.gz"])
def test_unknown_suffix(tmp_path, act, name):
    """Another suffix is refused with the known ones, and no file appears."""
    with pytest.raises(RecordError, match=r"unknown suffix .*\.log, \.asc, \.blf, \.mf4"):
        act(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@REFUSALS
def test_mdf_without_its_extra(tmp_path, monkeypatch, act):
    """Without asammdf an .mf4 recording is refused with the command that mends it."""
    monkeypatch.setattr("bench.recorder.find_spec", lambda name: None)
    with pytest.raises(RecordError, match=r"run\.mf4: needs asammdf: pip install 'strokebench\[mdf\]'"):
        act(tmp_path / "run.mf4")
    assert list(tmp_path.iterdir()) == []


def test_good_target(tmp_path):
    """A target that can be written passes the check, and the check writes nothing."""
    check_target(tmp_path / "run.log")
    assert list(tmp_path.iterdir()) == []


def test_whole_or_absent(tmp_path):
    """A recording that fails half-way leaves the file that was there, and nothing beside it."""
    path = tmp_path / "run.log"
    path.write_text("before")
    with pytest.raises(AttributeError):
        record(path, [*ROWS, (7_000_000_000, None, "IFD")])
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


@REFUSALS
def test_no_such_folder(tmp_path, act):
    """A folder that does not exist is one line that names the file."""
    with pytest.raises(RecordError, match=r"run\.log: "):
        act(tmp_path / "none" / "run.log")

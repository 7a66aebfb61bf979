"""Files whole or absent: a target appears complete, keeps what it held if writing fails, or is refused."""

import os
import threading

import pytest

from bench.errors import LapError, RecordError
from bench.whole import check_writable, whole

TOO_LONG = "a" * 300


def write(path, text="new", **more):
    with whole(path, **more) as part:
        part.write_text(text)


def test_appears_when_done(tmp_path):
    """Until the block ends the target is not there; then it is, and nothing lies beside it."""
    path = tmp_path / "out.json"
    with whole(path) as part:
        part.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_replaces(tmp_path):
    """A file that was there is replaced."""
    path = tmp_path / "out.json"
    path.write_text("old, and longer")
    write(path)
    assert path.read_text() == "new"


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError, SystemExit])
def test_interrupted(tmp_path, error):
    """Whatever ends the block early, the old file stays and nothing half-written is left."""
    path = tmp_path / "out.json"
    path.write_text("old")

    def interrupted():
        with whole(path) as part:
            part.write_text("half")
            raise error

    with pytest.raises(error):
        interrupted()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("refuse", [write, check_writable], ids=["write", "check"])
@pytest.mark.parametrize(
    ("name", "says"),
    [
        (".", "is a folder"),
        ("none/out.json", r"none/out\.json: (no folder|cannot be written: no such file)"),
        (TOO_LONG, "file name too long"),
        ("a_file/out.json", "(no folder|not a directory)"),
    ],
    ids=["folder", "no-folder", "long-name", "file-as-folder"],
)
def test_refused(tmp_path, refuse, name, says):
    """A target that cannot be is one line that names it, and nothing is made."""
    (tmp_path / "a_file").touch()
    with pytest.raises(RecordError, match=says) as caught:
        refuse(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["a_file"]


def test_error_of_the_callers_kind(tmp_path):
    """The error is of the kind the caller names."""
    with pytest.raises(LapError, match="is a folder"):
        write(tmp_path, error=LapError)
    with pytest.raises(LapError, match="is a folder"):
        check_writable(tmp_path, LapError)


def test_no_space(tmp_path):
    """An error of the system while the block writes is the one line, and leaves nothing."""

    def full():
        with whole(tmp_path / "out.json") as part:
            part.write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(RecordError, match=r"out\.json: cannot be written: no space left on device"):
        full()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_folder_without_permission(tmp_path):
    """A folder that may not be written to is found before the work, not after."""
    tmp_path.chmod(0o500)
    with pytest.raises(RecordError, match="is not writable"):
        check_writable(tmp_path / "out.json")
    tmp_path.chmod(0o700)


def test_check_makes_nothing(tmp_path):
    """A good target passes the check, and the check leaves no trace."""
    check_writable(tmp_path / "out.json")
    assert list(tmp_path.iterdir()) == []


def test_pipe(tmp_path):
    """A pipe, or a device, is written to and stays what it is."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    got = []
    reader = threading.Thread(target=lambda: got.append(path.read_text()))
    reader.start()
    check_writable(path)
    write(path)
    reader.join()
    assert got == ["new"]
    assert path.is_fifo()
    assert list(tmp_path.iterdir()) == [path]

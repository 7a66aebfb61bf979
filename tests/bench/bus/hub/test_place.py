"""Where hubs live: names, a directory that is ours alone, one lock."""

import os
from pathlib import Path

import pytest

from bench.bus.hub.place import Lock, Place, channels
from bench.errors import BusError
from bench.private import own_directory


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "../x", "-v", "a b", "a\0", "x" * 65, "ä", "a\n"])
def test_name_that_is_none(name):
    """A name that could leave the directory, or be read as something else, is refused."""
    with pytest.raises(BusError, match=r"channel .*: a name has 1 to 64"):
        Place.of(name)


@pytest.mark.parametrize("name", ["bus0", "0", "_x", "a.b-c+d", "x" * 64])
def test_name(name, runtime):
    """Others become a socket and a lock in the user's directory."""
    place = Place.of(name)
    assert place.socket == Path(runtime, "strokebench", f"{name}.sock")
    assert place.lock.parent == place.socket.parent


def test_directory_is_made_for_the_user_alone():
    """Nobody else may enter the directory that is made."""
    assert own_directory().stat().st_mode & 0o777 == 0o700


def test_directory_without_a_runtime_directory(monkeypatch):
    """Without XDG_RUNTIME_DIR it is /tmp's, named after the user."""
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert own_directory() == Path(f"/tmp/strokebench-{os.getuid()}")


def test_directory_open_to_others(runtime):
    """A directory that others may enter is refused: they could put a socket there."""
    own_directory().chmod(0o755)
    with pytest.raises(BusError, match=r"strokebench: others may enter it \(mode 755, wanted 700\)"):
        own_directory()


def test_directory_of_another_user(monkeypatch):
    """A directory that somebody else has made is refused."""
    own_directory()
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    with pytest.raises(BusError, match=r"belongs to user \d+, not to 12345"):
        own_directory()


@pytest.mark.parametrize("make", [lambda path: path.touch(), lambda path: path.symlink_to("/")])
def test_directory_that_is_none(runtime, make):
    """A file in its place, or a link to elsewhere, is refused."""
    make(Path(runtime, "strokebench"))
    with pytest.raises(BusError, match="strokebench: n"):
        own_directory()


def test_path_too_long(monkeypatch, runtime):
    """A path that no socket can have is one line."""
    deep = Path(runtime, "d" * 100)
    deep.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    with pytest.raises(BusError, match="longer than the 107 bytes of a socket's name"):
        Place.of("bus0")


def test_lock_has_one_holder():
    """Only one has the lock, and the file names its process; once it is released another one may have it."""
    place = Place.of("bus0")
    first, second = Lock(place.lock), Lock(place.lock)
    assert first.take()
    assert not second.take()
    assert second.holder() == str(os.getpid())
    first.release()
    assert second.take()
    second.release()


def test_channels():
    """Channels are those with a socket of a name that can be one."""
    folder = own_directory()
    for name in ("b.sock", "a.sock", "c.lock", ".sock", "-x.sock"):
        (folder / name).touch()
    assert channels() == ["a", "b"]

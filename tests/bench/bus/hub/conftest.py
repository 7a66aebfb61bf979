"""A directory for the hubs of each test, hubs in this process, and nodes that are always shut down."""

import shutil
import tempfile
import threading
from contextlib import ExitStack, contextmanager

import pytest

from bench.bus.hub.client import HubBus
from bench.bus.hub.server import Hub


@pytest.fixture(autouse=True)
def runtime(monkeypatch):
    """The user's runtime directory, at a path that is short enough for a socket."""
    folder = tempfile.mkdtemp(prefix="hub-")
    monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
    yield folder
    shutil.rmtree(folder)


@contextmanager
def working(channel="bus0", **how):
    """A hub at work in a thread of this process."""
    over = threading.Event()
    with Hub(channel, **how) as hub:
        worker = threading.Thread(target=lambda: [hub.turn(0.01) for _ in iter(over.is_set, True)])
        worker.start()
        try:
            yield hub
        finally:
            over.set()
            worker.join()


@pytest.fixture
def hub():
    """Start a hub in this process: call it with what `Hub` takes."""
    with ExitStack() as stack:
        yield lambda *channel, **how: stack.enter_context(working(*channel, **how))


@pytest.fixture
def node():
    """Put a node on the bus: call it with what `HubBus` takes."""
    with ExitStack() as stack:

        def put(channel="bus0", **how):
            bus = HubBus(channel, **how)
            stack.callback(bus.shutdown)
            return bus

        yield put

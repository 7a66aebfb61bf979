"""A bus that python-can drives: frames there and back, what is none of ours, buses that are not there."""

import logging
import time

import can
import pytest

from bench.bus.live import LiveBus
from bench.errors import BusError
from targets.ecu import Frame


@pytest.fixture
def wire(request):
    """Two ends of a bus that python-can emulates within the process."""
    name = f"virtual:{request.node.name}"
    with LiveBus(name) as one, LiveBus(name) as other:
        yield one, other


def test_frame_there_and_back(wire):
    """Standard, extended and empty frames arrive as they were sent, with an age."""
    here, there = wire
    for frame in (Frame(0x100, b"\x01\x02"), Frame(0x1ABCDEF0, bytes(8), True), Frame(0, b"")):
        here.send(frame)
        heard = there.receive(1.0)
        assert heard.frame == frame
        assert 0 <= heard.age_ns < 1_000_000_000


def test_silence(wire):
    """With nothing to hear, receiving ends after its time."""
    start = time.monotonic()
    assert wire[0].receive(0.02) is None
    assert 0.015 < time.monotonic() - start < 10  # a mistaken unit would be 20


@pytest.mark.parametrize(
    "kind",
    [{"is_remote_frame": True}, {"is_error_frame": True}, {"is_fd": True}],
    ids=["remote", "error", "fd"],
)
def test_what_is_no_data_frame_passes(wire, kind):
    """Remote, error and FD frames are passed over to the data frame behind them, and do not hold up."""
    here, there = wire
    for _ in range(3):
        here._bus.send(can.Message(arbitration_id=1, is_extended_id=False, **kind))
    here.send(Frame(0x123, b"x"))
    assert there.receive(1.0).frame == Frame(0x123, b"x")
    here._bus.send(can.Message(arbitration_id=1, is_extended_id=False, **kind))
    begun = time.monotonic()
    assert there.receive(20) is None
    assert time.monotonic() - begun < 10


def test_error_frames_without_end(wire, monkeypatch):
    """A bus that carries nothing but error frames still lets the caller go."""
    error = can.Message(is_error_frame=True)
    monkeypatch.setattr(wire[0]._bus, "recv", lambda timeout: error)
    assert wire[0].receive(0.01) is None


@pytest.mark.parametrize("stamp_s", [0.0, 5e9], ids=["from-power-on", "future"])
def test_stamps_from_another_epoch(wire, monkeypatch, stamp_s):
    """An adapter that counts from its own power-on gives frames no age."""
    message = can.Message(timestamp=stamp_s, arbitration_id=1, is_extended_id=False)
    monkeypatch.setattr(wire[0]._bus, "recv", lambda timeout: message)
    assert wire[0].receive(0.01).age_ns == 0


@pytest.mark.parametrize("act", [lambda bus: bus.receive(0), lambda bus: bus.send(Frame(1, b""))])
def test_closed_interface(act):
    """An interface that is gone is a BusError naming the bus."""
    with LiveBus("virtual:closed") as bus:
        bus._bus.shutdown()
        with pytest.raises(BusError, match=r"virtual:closed: cannot (send 0x1|receive): .*closed"):
            act(bus)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("carrier_pigeon:1", "no interface 'carrier_pigeon'; python-can has .*socketcan"),
        ("", "no interface ''"),
        ("socketcan:nocan99", "socketcan:nocan99: cannot be opened: "),
        ("socketcan", "socketcan: cannot be opened: "),
        ("kvaser:0", "kvaser:0: cannot be opened: "),
        ("slcan:/dev/nothing", "slcan:/dev/nothing: cannot be opened: "),
        ("pcan", "pcan: cannot be opened: "),
    ],
)
def test_bus_that_cannot_be_opened(name, says, capfd, monkeypatch):
    """A bus that does not exist here is one line, whatever its driver raises, and python-can adds none."""
    monkeypatch.setattr(logging.root, "handlers", [])  # pytest's own, which would be told instead
    with pytest.raises(BusError, match=says) as caught:
        LiveBus(name)
    assert "\n" not in str(caught.value)
    logging.getLogger("can").error("would be said")
    assert capfd.readouterr().err == ""

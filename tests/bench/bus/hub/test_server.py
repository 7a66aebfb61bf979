"""The hub's connections: greetings, hostile and dead clients, a name taken or left behind, its own end."""

import os
import random
import signal
import socket
import subprocess
import sys
from pathlib import Path

import can
import pytest

from bench.bus.hub import server, wire
from bench.bus.hub.place import Place
from bench.bus.hub.server import Hub, HubRunning
from bench.bus.hub.start import running

HELLO = wire.pack(wire.HELLO, 0, wire.VERSION)
FRAME = wire.pack(wire.FRAME, 0, 2, 0x123, 0, b"ab")
MESSAGE = can.Message(arbitration_id=0x100, is_extended_id=False, data=b"ok")


def raw(*sent):
    """A connection that sends what it likes."""
    end = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    end.settimeout(10)
    end.connect(str(Place.of("bus0").socket))
    for data in sent:
        end.sendall(data)
    return end


def said(end):
    """Everything the hub says until it closes."""
    heard = b""
    try:
        while data := end.recv(4096):
            heard += data
    except ConnectionResetError:
        pass  # it closed with bytes of ours unread
    end.close()
    return [record for _, record in wire.whole(heard)]


@pytest.mark.parametrize(
    ("sent", "says"),
    [
        (b"GET / HTTP/1.1\r\n\r\n" * 5, "the first record is no HELLO"),
        (FRAME, "the first record is no HELLO"),
        (bytes(16), "a record of 0 bytes"),
        (
            wire.pack(wire.HELLO, 0, wire.VERSION + 1),
            f"speaks version {wire.VERSION}, the client {wire.VERSION + 1}",
        ),
        (
            wire.pack(wire.HELLO, 0, wire.VERSION, 500_000),
            "the hub runs untimed, the client asks for 500000 bit/s",
        ),
    ],
)
def test_greeting_that_is_none(hub, sent, says):
    """Who does not greet as it should hears why and is off; the hub goes on."""
    hub()
    record = said(raw(sent))[-1]
    assert record.kind == wire.REFUSED
    assert says in wire.text(record)
    assert running() == ["bus0"]


@pytest.mark.parametrize("seed", range(10))
def test_hostile_client(hub, node, seed):
    """A client that sends what is no frame is dropped, what it sent before counts, and the others go on."""
    hub()
    here, there = node(), node()
    draw = random.Random(seed)
    end = raw(HELLO, FRAME, draw.randbytes(draw.randrange(80, 20_000)))
    assert there.recv(10).arbitration_id == 0x123
    said(end)
    here.send(MESSAGE)
    while (heard := there.recv(10)).arbitration_id != 0x100:
        pass  # what happened to be a frame
    assert heard.data == b"ok"


@pytest.mark.parametrize("cut", [1, 15, 17])
def test_truncated_client(hub, node, cut):
    """A frame whose end never comes is none."""
    hub()
    here, there = node(), node()
    raw(HELLO, FRAME, FRAME[:cut]).close()
    assert there.recv(10).arbitration_id == 0x123
    here.send(MESSAGE)
    assert there.recv(10).arbitration_id == 0x100


def test_frames_in_pieces(hub, node):
    """A stream may cut records anywhere, the greeting included."""
    hub()
    there = node()
    end = raw()
    for byte in HELLO + FRAME:
        end.sendall(bytes([byte]))
    assert there.recv(10).data == b"ab"
    end.close()


def test_client_killed(hub, node):
    """What a killed process has sent still arrives, all of it, and the others go on."""
    hub()
    here, there = node(), node()
    code = (
        "import os, can; from bench.bus.hub.client import HubBus; bus = HubBus()\n"
        "for i in range(200): bus.send(can.Message(arbitration_id=i))\n"
        "os.kill(os.getpid(), 9)"
    )
    killed = subprocess.run([sys.executable, "-c", code], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert [there.recv(10).arbitration_id for _ in range(200)] == list(range(200))
    here.send(MESSAGE)
    assert there.recv(10).arbitration_id == 0x100


def test_connection_that_says_nothing(hub, monkeypatch):
    """Who never greets is dropped after a while."""
    monkeypatch.setattr(server, "GREETING_S", 0.05)
    hub()
    assert said(raw()) == []


def test_too_many_clients(monkeypatch):
    """One client too many hears why; when another one has left there is room."""
    monkeypatch.setattr(server, "CLIENTS", 1)
    with Hub("bus0") as hub:
        first = raw(HELLO)
        hub.turn()
        more = raw()
        hub.turn()
        assert wire.text(said(more)[0]) == "the hub has 1 clients, and takes no more"
        first.close()
        hub.turn()
        second = raw(HELLO)
        hub.turn()
        hub.turn()
        assert second.recv(16)[1] == wire.WELCOME
        second.close()


def test_one_hub_a_channel(hub):
    """A second hub of the channel is refused, with the first one's process; another channel has its own."""
    hub()
    with pytest.raises(
        HubRunning, match=f"strokebench:bus0: a hub is running already, process {os.getpid()}"
    ):
        Hub("bus0").__enter__()
    hub("bus1")
    assert running() == ["bus0", "bus1"]


def test_socket_left_behind(hub, node):
    """The socket of a killed hub is replaced."""
    place = Place.of("bus0")
    left = socket.socket(socket.AF_UNIX)
    left.bind(str(place.socket))
    left.close()
    assert running() == []
    hub()
    assert running() == ["bus0"]
    node()


def test_name_is_given_back():
    """A hub that ends leaves no socket, and the channel is free."""
    for _ in range(2):
        with Hub("bus0"):
            assert Path(Place.of("bus0").socket).exists()
        assert not Path(Place.of("bus0").socket).exists()


def test_end_after_the_last_client():
    """A hub that was started for its clients serves until the last one has left, and no longer."""
    with Hub("bus0", idle_s=0) as hub:
        hub._alone_ns = None
        first, second = raw(HELLO), raw(HELLO)
        first.close()
        hub.turn()
        hub.turn()
        assert not hub._abandoned(hub._now())
        second.close()
        hub.serve()
        assert hub._abandoned(hub._now())


def test_process_of_a_client():
    """Notices name the process of a client as the system knows it."""
    here, there = socket.socketpair(socket.AF_UNIX)
    assert server._process(here) == f" (process {os.getpid()})"
    here.close()
    there.close()

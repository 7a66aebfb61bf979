"""The python-can interface: messages, waiting, a hub that dies, many processes, threads, loops."""

import asyncio
import itertools
import os
import select
import signal
import threading
import time
import tomllib
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from itertools import takewhile
from pathlib import Path

import can
import pytest

from bench.bus.hub.client import HubBus
from bench.bus.hub.exchange import QUEUE_BYTES
from bench.bus.hub.place import Place
from bench.bus.hub.start import running
from bench.bus.live import LiveBus
from bench.errors import BusError
from targets.ecu import Frame

ROOT = Path(__file__).resolve().parents[4]


def message(identifier=0x123, data=b"\x01\x02", **more):
    return can.Message(arbitration_id=identifier, is_extended_id=False, data=data, **more)


def killed(channel="bus0"):
    """Kill the hub of the channel, which is a process of its own."""
    os.kill(int(Place.of(channel).lock.read_text()), signal.SIGKILL)


def flood(bus, timeout, sent=None):
    """Send 8 bytes as identifiers 0, 1, ..., 7FF, 0, ... until something comes up; each goes into `sent`."""
    for number in itertools.count():
        bus.send(message(number % 2048, bytes(8)), timeout)
        if sent is not None:
            sent.append(number)


def test_entry_point():
    """The package's metadata lead python-can to the class."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    module, _, name = project["entry-points"]["can.interface"]["strokebench"].partition(":")
    assert getattr(import_module(module), name) is HubBus


def test_started_on_first_use(node):
    """The first node starts a hub, the second finds it, and a killed one is replaced."""
    here, there = node(), node()
    here.send(message())
    assert there.recv(10).data == b"\x01\x02"
    assert HubBus._detect_available_configs() == [{"interface": "strokebench", "channel": "bus0"}]
    first = Place.of("bus0").lock.read_text()
    killed()
    here, there = node(), node()
    here.send(message())
    assert there.recv(10).data == b"\x01\x02"
    assert Place.of("bus0").lock.read_text() != first
    killed()


def test_all_start_at_once():
    """Of many that find no hub at once and start one each, all come to the same."""
    buses, errors = [], []

    def join():
        try:
            buses.append(HubBus())
        except can.CanError as error:
            errors.append(error)

    threads = [threading.Thread(target=join) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors
    for number, bus in enumerate(buses):
        bus.send(message(number))
    for number, bus in enumerate(buses):
        others = {bus.recv(10).arbitration_id for _ in range(3)}
        assert others == {0, 1, 2, 3} - {number}
    killed()
    for bus in buses:
        bus.shutdown()


def test_hub_killed(hub, node):
    """A hub that dies under its nodes is one CanOperationError that names the channel, once all is read."""
    here, there = node(), node()
    here.send(message(1))
    assert there.recv(10)
    here.send(message(2))
    assert select.select([there._socket], [], [], 10)[0]
    killed()
    assert there.recv(10).arbitration_id == 2
    for act in (lambda: there.recv(10), lambda: there.recv(0), lambda: there.send(message())):
        with pytest.raises(can.CanOperationError, match=r"^strokebench:bus0: its hub has ended$"):
            act()
    assert there.state is can.BusState.ERROR
    with pytest.raises(can.CanOperationError, match=r"^strokebench:bus0: its hub has ended$"):
        flood(here, 10)


def test_slow_node_is_named(hub, node):
    """Who sends to a bus that one node holds up waits its time, and is told which process that is."""
    hub()
    here, _ = node(), node()
    with pytest.raises(can.CanTimeoutError) as caught:
        flood(here, 2)
    assert str(caught.value) == (
        f"strokebench:bus0: not sent within 2 s: client 2 (process {os.getpid()}) does not read"
    )


def test_slow_node_goes_on(hub, node):
    """Once it reads again, nothing is missing and the others may send."""
    hub()
    here, there = node(), node()
    sent = []
    with pytest.raises(can.CanTimeoutError):
        flood(here, 2, sent)
    sent = len(sent)
    assert sent > QUEUE_BYTES // 24
    sender = threading.Thread(target=here.send, args=(message(5),))
    sender.start()
    assert [there.recv(10).arbitration_id for _ in range(sent)] == [number % 2048 for number in range(sent)]
    assert there.recv(10).arbitration_id == 5
    sender.join()


def test_node_that_never_reads(hub, node):
    """It is put off the bus after the hub's patience, and hears that after all it was sent before."""
    hub(patience_s=0.1)
    here, there = node(), node()
    for _ in range(QUEUE_BYTES // 24 + 20_000):
        here.send(message(data=bytes(8)))
    with pytest.raises(can.CanOperationError, match=r"client 2 .* read nothing for 0.1 s while \d+ bytes"):
        deque(iter(lambda: there.recv(10), None), 0)


def test_two_that_only_send(hub, node):
    """Nodes that send without reading do not hold each other up: they read while they wait."""
    hub(patience_s=60)
    count = QUEUE_BYTES // 24 + 20_000

    def use(bus):
        for _ in range(count):
            bus.send(message(data=bytes(8)), timeout=30)
        # Nobody reads for a node that has sent all: without this the slower one would wait for it.
        return sum(1 for _ in takewhile(bool, (bus.recv(10) for _ in range(count))))

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(use, [node(), node()])) == [count] * 2


@pytest.mark.parametrize(
    ("what", "says"),
    [
        (message(0x800), "identifier 0x800 has more than 11 bits"),
        (message(data=bytes(9)), "a classic frame has no 9 bytes"),
        (message(data=bytes(9), is_fd=True), "an FD frame has no 9 bytes"),
        (message(data=b"", dlc=3), "0 bytes of data at DLC 3"),
    ],
)
def test_message_that_is_no_frame(hub, node, what, says):
    """What no bus can carry is refused where it is sent."""
    hub()
    bus = node()
    with pytest.raises(can.CanOperationError, match=f"^strokebench:bus0: {says}"):
        bus.send(what)


def test_node_without_fd(hub, node):
    """A node that was opened for classic frames neither sends nor hears FD frames."""
    hub()
    here, there = node(), node(fd=False)
    assert (here.protocol, there.protocol) == (can.CanProtocol.CAN_FD, can.CanProtocol.CAN_20)
    here.send(message(1, bytes(64), is_fd=True))
    here.send(message(2))
    assert there.recv(10).arbitration_id == 2
    with pytest.raises(can.CanOperationError, match="cannot send an FD frame on a bus of classic frames"):
        there.send(message(is_fd=True))


def test_shut_down(hub, node):
    """A node that has left says so, as often as it is used; what it sent before arrives."""
    hub()
    here, there = node(), node()
    here.send(message())
    here.shutdown()
    here.shutdown()
    assert there.recv(10)
    for act in (lambda: here.recv(0), lambda: here.send(message())):
        with pytest.raises(can.CanOperationError, match=r"^strokebench:bus0: is shut down$"):
            act()
    assert here.fileno() == -1


def test_shutdown_wakes_who_waits(hub, node):
    """A thread that waits for a frame hears that the node leaves."""
    hub()
    bus, caught = node(), []

    def wait():
        try:
            bus.recv(60)
        except can.CanOperationError as error:
            caught.append(str(error))

    waiter = threading.Thread(target=wait)
    waiter.start()
    while not bus._hearing.locked():
        time.sleep(0)
    bus.shutdown()
    waiter.join()
    assert caught == ["strokebench:bus0: is shut down"]


@pytest.mark.parametrize("ahead", [True, False])
def test_loop_hears_what_was_read_ahead(hub, node, ahead):
    """In an asyncio loop a burst arrives whole, though the node reads more than a frame at once."""
    hub()
    here, there = node(), node()

    async def listen():
        reader = can.AsyncBufferedReader()
        if ahead:  # also what was read before the loop looked
            [here.send(message(number)) for number in range(500)]
            assert there.recv(10).arbitration_id == 0
        with can.Notifier(there, [reader], loop=asyncio.get_running_loop()):
            if not ahead:
                [here.send(message(number)) for number in range(500)]
            first = 1 if ahead else 0
            return [
                (await asyncio.wait_for(reader.get_message(), 10)).arbitration_id for _ in range(first, 500)
            ]

    assert asyncio.run(listen()) == list(range(1 if ahead else 0, 500))


def test_loop_and_a_dead_hub(node):
    """In a loop the hub's end is reported and does not keep the loop busy."""
    bus = node()
    readable = bus.fileno()
    killed()
    assert select.select([bus._socket], [], [], 10)[0]
    with pytest.raises(can.CanOperationError):
        bus.recv(10)
    assert select.select([readable], [], [], 0) == ([], [], [])


def test_thread_safe(hub, node):
    """Many threads of one node: every frame is sent once and heard once."""
    hub()
    here, there = node(), node()
    heard = []
    senders = [
        threading.Thread(target=lambda n=n: [here.send(message(n * 100 + i)) for i in range(100)])
        for n in range(8)
    ]
    hearers = [
        threading.Thread(target=lambda: heard.extend(there.recv(10) for _ in range(100))) for _ in range(8)
    ]
    for thread in senders + hearers:
        thread.start()
    for thread in senders + hearers:
        thread.join()
    assert sorted(each.arbitration_id for each in heard) == list(range(800))


def test_periodic(hub, node):
    """A periodic task sends until it is stopped."""
    hub()
    here, there = node(), node()
    task = here.send_periodic(message(9), 0.001)
    assert [there.recv(10).arbitration_id for _ in range(20)] == [9] * 20
    task.stop()


def test_timed(hub, node):
    """On a timed hub times advance by the frames' lengths, and the lower identifier goes first."""
    rate = 2_000  # so low that a second passes before the last of the first frames has gone
    hub(timed=rate)
    low, high, there = node(timed=rate), node(), node()
    assert there.protocol is can.CanProtocol.CAN_20
    for _ in range(20):
        high.send(message(0x700, bytes(8)))
    for _ in range(5):
        low.send(message(0x100, bytes(8)))
    heard = [there.recv(10) for _ in range(25)]
    assert [each.arbitration_id for each in heard].index(0x100) < 20
    spans = [b.timestamp - a.timestamp for a, b in itertools.pairwise(heard)]
    assert min(spans) > 111 / rate - 1e-5  # a frame of 8 bytes has 111 bits without stuffing
    with pytest.raises(can.CanOperationError, match="cannot send an FD frame on a bus of classic frames"):
        there.send(message(is_fd=True))


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({"timed": 250_000}, "^strokebench:bus0: the hub runs untimed, the client asks for 250000 bit/s$"),
        ({"timed": 0}, r"^strokebench:bus0: bit rate 0 bit/s is not within 1 to 1000000"),
        ({"timed": -1}, r"^strokebench:bus0: bit rate -1 bit/s is not within 1 to 1000000"),
        ({"timed": "fast"}, "^strokebench:bus0: invalid literal"),
        ({"channel": "a/b"}, "^strokebench:a/b: channel 'a/b': a name has"),
    ],
)
def test_bus_that_cannot_be_had(hub, how, says):
    """Another hub than asked for, or a name that is none, is one CanInitializationError."""
    hub()
    with pytest.raises(can.CanInitializationError, match=says):
        HubBus(**how)


def test_hub_that_cannot_start():
    """If the hub that was to be started cannot be, its reason is handed on."""
    place = Place.of("bus0")
    place.socket.mkdir()
    with pytest.raises(
        can.CanInitializationError, match=r"^strokebench:bus0: /.*/bus0.sock: Is a directory$"
    ):
        HubBus()
    assert running() == []


def test_live_bus(hub):
    """The bench's own end of a bus takes it by name, without an entry point, and names it in its errors."""
    hub("lab")
    with LiveBus("strokebench:lab") as here, LiveBus("strokebench:lab") as there:
        here.send(Frame(0x100, b"\x01"))
        assert there.receive(10).frame == Frame(0x100, b"\x01")
        assert there.receive(0) is None
    with pytest.raises(
        BusError, match=r"^strokebench:\.\.: cannot be opened: strokebench:\.\.: channel '\.\.'"
    ):
        LiveBus("strokebench:..")


def test_live_bus_names_who_holds_it_up(hub, node):
    """The bench is told which node does not read, where the hub has no room for a frame."""
    hub("lab", patience_s=60)
    node("lab")
    with LiveBus("strokebench:lab") as here:
        while here.send(Frame(0x100, bytes(8)), 0.2):
            assert here.refusal == ""
        assert here.refusal == f"client 1 (process {os.getpid()}) does not read"


def test_process_with_many_open_files(node):
    """A node whose descriptor is beyond what select() can watch still hears, and still stops waiting."""
    sender = node()
    files = [os.open(os.devnull, os.O_RDONLY) for _ in range(1024)]
    try:
        late = node()
        sender.send(message())
        assert late.recv(10).data == b"\x01\x02"
        assert late.recv(0.01) is None
    finally:
        for file in files:
            os.close(file)

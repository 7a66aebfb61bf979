"""What holds on each bus without hardware: the emulated one, ours, multicast, SocketCAN.

Where the kernel has no vcan0, `test_kernel_with_can` runs the SocketCAN part in one brought up for it.
"""

import contextlib
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path

import can
import pytest

from bench.bus.hub.client import HubBus
from bench.bus.live import LiveBus
from targets.ecu import Frame
from tests.hil.test_live_rides import FLAGS, came_up, launcher

ROOT = Path(__file__).resolve().parents[2]
KERNEL_HAS_CAN = FLAGS.exists() and int(FLAGS.read_text(), 16) & 1
CHANNELS = {
    "virtual": "contract",
    "strokebench": "contract",
    "udp_multicast": "239.74.163.7",
    "socketcan": "vcan0",
}

HEARS_ITSELF = ("udp_multicast",)
"""Buses that cannot keep a node's own frames from it."""
LOCAL_IS_SENT = ("socketcan",)
"""Buses that call every frame of this machine a sent one, whoever listens."""
BURST = 100
"""Frames on end that each of them holds: SocketCAN's default buffer has room for 278."""

FRAMES = {
    "standard": {"arbitration_id": 0x123, "is_extended_id": False, "data": b"\1\2\3\4\5\6\7\x08"},
    "extended": {"arbitration_id": 0x1ABCDEF0, "data": b"\xff"},
    "lowest": {"arbitration_id": 0, "is_extended_id": False},
    "highest": {"arbitration_id": 0x1FFFFFFF, "data": bytes(8)},
    "remote": {"arbitration_id": 0x200, "is_extended_id": False, "is_remote_frame": True, "dlc": 4},
    "fd": {"arbitration_id": 0x300, "is_fd": True, "data": bytes(range(64))},
    "fd with its flags": {
        **{"arbitration_id": 0x301, "is_fd": True, "bitrate_switch": True, "error_state_indicator": True},
        "data": bytes(12),
    },
}


def multicast():
    """Why there is no multicast here, None if there is."""
    try:
        with can.Bus(interface="udp_multicast", channel=CHANNELS["udp_multicast"]) as bus:
            bus.send(can.Message())
            return None if bus.recv(1) else "multicast does not come back"
    except (can.CanError, OSError, ImportError) as error:
        return str(error)


@pytest.fixture(scope="module", params=list(CHANNELS))
def interface(request):
    """Each interface in turn; one that is not to be had here is skipped with the reason."""
    if request.param == "socketcan" and not KERNEL_HAS_CAN:
        pytest.skip("no vcan0 in this kernel; test_kernel_with_can has one of its own")
    if request.param == "udp_multicast" and (reason := multicast()):
        pytest.skip(f"no multicast: {reason}")
    return request.param


@pytest.fixture(autouse=True)
def runtime(monkeypatch):
    """A directory for hubs of this test alone."""
    folder = tempfile.mkdtemp(prefix="hub-")
    monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
    yield
    shutil.rmtree(folder)


@pytest.fixture
def node(interface):
    """Put a node on the bus; of ours also where its entry point is not installed."""
    with contextlib.ExitStack() as stack:

        def put(**how):
            how = {"fd": True, **how}
            if interface == "strokebench":
                bus = HubBus(CHANNELS[interface], **how)
            else:
                bus = can.Bus(interface=interface, channel=CHANNELS[interface], **how)
            stack.callback(bus.shutdown)
            return bus

        yield put


def message(identifier, **more):
    return can.Message(arbitration_id=identifier, is_extended_id=False, **more)


def test_nothing_sent(node):
    """A silent bus gives nothing, at once or after a while."""
    bus = node()
    assert bus.recv(0) is None
    assert bus.recv(0.02) is None


@pytest.mark.parametrize("kind", FRAMES)
def test_frame_as_it_was(interface, node, kind):
    """Every kind of frame arrives as it was sent, as a received one, with the time of day."""
    here, there = node(), node()
    sent = can.Message(**FRAMES[kind], check=True)
    before = time.time()
    here.send(sent)
    heard = there.recv(10)
    assert heard.equals(sent, timestamp_delta=None, check_channel=False, check_direction=False)
    assert heard.is_rx is (interface not in LOCAL_IS_SENT)
    assert before - 0.1 <= heard.timestamp <= time.time() + 0.1


def test_order_and_number(node):
    """A burst arrives whole and in order at every listener, in the course of time."""
    here, *listeners = node(), node(), node()
    for number in range(BURST):
        here.send(message(number, data=[number]))
    for listener in listeners:
        heard = [listener.recv(10) for _ in range(BURST)]
        assert [each.arbitration_id for each in heard] == list(range(BURST))
        assert all(a.timestamp <= b.timestamp for a, b in pairwise(heard))
        assert listener.recv(0) is None


def test_one_order_for_all(interface, node):
    """Frames of several senders at once come in the same order to all who listen."""
    if interface == "udp_multicast":
        pytest.skip("datagrams of several senders reach each listener in an order of its own")
    senders, listeners = [node(), node(), node()], [node(), node()]
    threads = [
        threading.Thread(
            target=lambda n=n, bus=bus: [bus.send(message(n, data=[i])) for i in range(BURST // 3)]
        )
        for n, bus in enumerate(senders)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    total = len(senders) * (BURST // 3)
    one, other = (
        [(m.arbitration_id, m.data[0]) for m in (bus.recv(10) for _ in range(total))] for bus in listeners
    )
    assert one == other
    for n in range(len(senders)):
        assert [i for sender, i in one if sender == n] == list(range(BURST // 3))


def test_own_frames(interface, node):
    """A node hears its own frames only if it asks to, and then as sent, not as received ones."""
    if interface in HEARS_ITSELF:
        pytest.skip("cannot be chosen on this bus: its nodes always hear themselves")
    quiet, echoed = node(), node(receive_own_messages=True)
    echoed.send(message(1))
    quiet.send(message(2))
    own, other = echoed.recv(10), echoed.recv(10)
    assert (own.arbitration_id, own.is_rx) == (1, False)
    assert (other.arbitration_id, other.is_rx) == (2, interface not in LOCAL_IS_SENT)
    assert quiet.recv(10).arbitration_id == 1
    assert quiet.recv(0) is None


def test_filters(node):
    """A node hears what passes its filters, set at the start or later, and all without any."""
    here = node()
    there = node(can_filters=[{"can_id": 0x100, "can_mask": 0x7F0, "extended": False}])
    for number in (0x10F, 0x110):
        here.send(message(number))
    assert there.recv(10).arbitration_id == 0x10F
    assert there.recv(0.05) is None
    there.set_filters(None)
    here.send(message(0x110))
    assert there.recv(10).arbitration_id == 0x110


def test_periodic(node):
    """A periodic task sends until it is stopped."""
    here, there = node(), node()
    task = here.send_periodic(message(9), 0.002)
    assert [there.recv(10).arbitration_id for _ in range(10)] == [9] * 10
    task.stop()


def test_notifier(node):
    """A notifier hands the frames to its listeners."""
    here, there = node(), node()
    reader = can.BufferedReader()
    with can.Notifier(there, [reader], timeout=0.05):
        here.send(message(5))
        assert reader.get_message(10).arbitration_id == 5


def test_shut_down(node):
    """A node may be shut down twice, and is of no use then."""
    here, there = node(), node()
    here.shutdown()
    here.shutdown()
    with pytest.raises((can.CanError, OSError, ValueError)):
        here.send(message(1))
    assert there.recv(0) is None


def test_other_process(interface, node):
    """What another process sends arrives, and it hears what this one sends."""
    if interface == "virtual":
        pytest.skip("lives in one process")
    name = f"{interface}:{CHANNELS[interface]}"
    code = (
        f"from bench.bus.live import LiveBus\nwith LiveBus({name!r}) as bus:\n"
        "    print('there', flush=True)\n"
        "    frame = bus.receive(20).frame\n    bus.send(frame._replace(id=frame.id + 1))"
    )
    bus = node()
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        bus.send(message(0x100, data=b"ab"))
        while (heard := bus.recv(20)).arbitration_id == 0x100:
            assert interface in HEARS_ITSELF
        assert (heard.arbitration_id, heard.data) == (0x101, b"ab")
    assert other.returncode == 0


def test_bench_end(interface):
    """The bench's own end of a bus takes each of them by name."""
    name = f"{interface}:{CHANNELS[interface]}"
    with LiveBus(name) as here, LiveBus(name) as there:
        here.send(Frame(0x100, b"\1\2"))
        assert there.receive(10).frame == Frame(0x100, b"\1\2")


@pytest.mark.vcan
def test_kernel_with_can(tmp_path):
    """The whole contract holds on SocketCAN, in a kernel that has it."""
    words = launcher()
    if not words:
        pytest.skip("this kernel has vcan0: the contract has run on it")
    report = tmp_path / "report.xml"
    command = [sys.executable, "-u", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:randomly"]
    # A test that hangs says in which line, before all this is ended.
    options = ["-k", "socketcan and not kernel_with_can", "-o", "faulthandler_timeout=90"]
    done = subprocess.run(
        [*words, *command, *options, "--junitxml", str(report), __file__],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    came_up(done)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "skipped" not in done.stdout.splitlines()[-1]
    assert 'failures="0"' in report.read_text()

"""An ECU on the bus with a debugger on it: who runs when, and that the ride is the same."""

from collections.abc import Generator

import numpy as np
import pytest

from bench.codec import Codec
from bench.gdb.session import Left, Onlooker, PowerCycle, Powered, Session, silent_bus
from bench.gdb.wire import Decoder, Packet, encode
from bench.mdlog.logger import schedule
from bench.rig import Ride, ride
from bench.sensors.codes import acquire
from bench.watch import Watch
from targets.emulated import EmulatedEcu
from targets.mcu.debugger import Debugger
from tests.conftest import wavy_lap

Talk = Generator[bytes, bytes, None]
PC, LR = b"pf", b"pe"


class Scripted:
    """The line to a debugger that does what `talk` yields, and goes when it ends.

    What it yields is a request, and what it gets the reply; b"\\x03" is sent when the machine next looks.
    """

    def __init__(self, talk: Talk) -> None:
        self._talk = talk
        self._decoder = Decoder()
        self._next = next(talk)

    def receive(self, wait: bool) -> bytes:
        if self._next == b"\x03":
            self._next = b""
            return b"\x03"
        if not wait:
            return b""
        if not self._next:
            raise Left
        out, self._next = encode(self._next), b""
        return out

    def send(self, data: bytes) -> None:
        for event in self._decoder.feed(data):
            if isinstance(event, Packet) and (not event.data.startswith(b"O") or event.data == b"OK"):
                try:
                    self._next = self._talk.send(event.data)
                except StopIteration:
                    self._next = b""


@pytest.fixture
def power_on(image, calibration):
    def on() -> Powered:
        ecu = EmulatedEcu(image, calibration)
        return Powered(ecu, Debugger(ecu.mcu))

    return on


@pytest.fixture(scope="module")
def frames():
    """Twenty input cycles."""
    return schedule(acquire(wavy_lap(0.2)), Codec())


def number(reply: bytes) -> int:
    return int.from_bytes(bytes.fromhex(reply.decode()), "little")


def debugged(power_on, frames, talk: Talk) -> Ride:
    """The lap ridden by an ECU whose debugger does `talk`; afterwards it is let go."""
    session = Session(power_on, Scripted(talk))
    return ride(frames, session, Onlooker(Codec()))


def test_a_session_changes_no_frame(power_on, frames, image):
    """Halted at every step and stepped there, the ECU sends what it sends alone, at the same time to 2 us."""
    halts = []

    def talk() -> Talk:
        yield b"Z1,%x,2" % image.symbol("ecu_step")
        while True:
            halts.append((yield b"vCont;c"))
            for _ in range(3):
                yield b"vCont;s:1"
                yield b"g"

    alone = ride(frames, power_on().ecu, Watch(Codec()))
    ridden = debugged(power_on, frames, talk())
    assert len(halts) == 20
    assert set(halts) == {b"T05thread:1;"}
    mine, plain = ([d for d in r.frames if d.node == "ifd"] for r in (ridden, alone))
    assert [d.frame.id for d in mine] == [d.frame.id for d in plain]
    assert [d.frame for d in mine if d.frame.id == 0x200] == [d.frame for d in plain if d.frame.id == 0x200]
    assert np.abs([a.t_start_ns - b.t_start_ns for a, b in zip(mine, plain, strict=True)]).max() <= 2000


def test_starts_halted_in_reset(power_on, frames, image):
    """The debugger finds the program at its first instruction, and steps that."""
    seen = []

    def talk() -> Talk:
        seen.append(number((yield PC)))
        yield b"vCont;s:1"
        seen.append(number((yield PC)))
        yield b"D"

    with pytest.raises(Left):
        debugged(power_on, frames, talk())
    reset = image.symbol("reset_handler")
    assert seen[0] == reset
    assert reset < seen[1] <= reset + 4


def test_step_asleep_waits_for_a_frame(power_on, frames, image):
    """A step of a sleeping core ends in the handler of the frame that wakes it, though that is 10 ms away."""
    seen = []

    def talk() -> Talk:
        yield b"Z1,%x,2" % image.symbol("sleep_until_frame")
        yield b"vCont;c"
        yield b"z1,%x,2" % image.symbol("sleep_until_frame")
        while image.function_at(number((yield PC))) == "sleep_until_frame":
            seen.append((yield b"vCont;s:1"))
        seen.append(image.function_at(number((yield PC))))
        yield b"k"

    with pytest.raises(Left):
        debugged(power_on, frames, talk())
    assert len(seen) < 20
    assert seen[-1] == "can1_rx0_handler"


def test_interrupt(power_on, frames):
    """0x03 halts a running machine with SIGINT."""
    seen = []

    def talk() -> Talk:
        yield b"vCont;c"

    class Impatient(Scripted):
        def receive(self, wait: bool) -> bytes:
            return super().receive(wait) if wait else b"\x03"

        def send(self, data: bytes) -> None:
            seen.append(data)

    with pytest.raises(Left):
        ride(frames, Session(power_on, Impatient(talk())), Onlooker(Codec()))
    assert encode(b"T02thread:1;") in b"".join(seen)


def test_fault_halts_where_it_happened(power_on, frames, image):
    """A fatal instruction is a halt like another: its text on the console, the program counter at it."""
    step, seen = image.symbol("ecu_step"), []

    def talk() -> Talk:
        yield b"M%x,2:00de" % step  # udf #0
        seen.append((yield b"vCont;c"))
        seen.append(number((yield PC)))
        seen.append(number((yield b"p0")))
        seen.append((yield b"vCont;c"))
        yield b"D"

    with pytest.raises(Left):
        debugged(power_on, frames, talk())
    assert seen == [b"T0bthread:1;", step, image.symbol("state"), b"T0bthread:1;"]


def test_a_mended_fault_runs_on(power_on, frames, image):
    """After the debugger has put the program counter past what was fatal, the machine runs on."""
    step = image.symbol("ecu_step")

    def talk() -> Talk:
        yield b"M%x,2:00de" % step
        while True:
            yield b"vCont;c"
            yield b"Pf=" + (yield LR)  # return from the function

    ridden = debugged(power_on, frames, talk())
    assert ridden.failure is None
    assert sum(d.node == "ifd" for d in ridden.frames) == 40


def test_reset_begins_again(power_on, frames, image):
    """monitor reset ends this life, and power_cycle begins one that is the same again."""
    seen = []

    def talk() -> Talk:
        yield b"Z1,%x,2" % image.symbol("ecu_step")
        for _ in range(2):
            yield b"vCont;c"
            seen.append((yield b"qRcmd," + b"time".hex().encode()))
            seen.append((yield b"qRcmd," + b"frames".hex().encode()))
            yield b"qRcmd," + b"reset".hex().encode()
            yield b"Z1,%x,2" % image.symbol("ecu_step")
        yield b"D"

    session = Session(power_on, Scripted(talk()))
    for _ in range(2):
        with pytest.raises(PowerCycle):
            ride(frames, session, Onlooker(Codec()))
        session.power_cycle()
    with pytest.raises(Left):
        ride(frames, session, Onlooker(Codec()))
    assert seen[:2] == seen[2:]
    assert bytes.fromhex(seen[1].decode()) == b"2 frames came over the bus, 0 were requested\n"


def test_silent_bus(power_on, image):
    """With nobody else on the bus time passes, and the debugger gets its interrupt."""
    seen = []

    def talk() -> Talk:
        yield b"Z1,%x,2" % image.symbol("sleep_until_frame")
        seen.append((yield b"vCont;c"))
        yield b"D"

    with pytest.raises(Left):
        silent_bus(Session(power_on, Scripted(talk())), 0)
    assert seen == [b"T05thread:1;"]

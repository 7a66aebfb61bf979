"""An ECU under a debugger: an `Ecu` like any other, whose virtual time stands still while GDB has halted it.

The rig, or the silent bus below, advances it and knows nothing of the debugger: halted, `advance` does not
return before the debugger lets the machine go. Belongs here: who runs when. Never: a socket, what a packet
means (stub), how the machine halts.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, NoReturn, Protocol

from bench.gdb.stub import FAULTED, INTERRUPTED, TRAPPED, Debuggee, Stop, Stub, Want
from bench.watch import Watch
from targets.ecu import Ecu, Frame, Transmission
from targets.errors import FirmwareFault

SLICE_NS = 1_000_000
"""Virtual time after which a running machine looks whether the debugger interrupts it."""


class Machine(Debuggee, Protocol):
    """The machine in the ECU, as a session needs it."""

    @property
    def now_ns(self) -> int:
        """The instant it has reached."""

    @property
    def hit(self) -> tuple[str, int] | None:
        """The break- or watchpoint at which it halted, None if none was hit since `resume`."""

    @property
    def reports(self) -> Mapping[str, Callable[[], str]]:
        """What it can say about itself, by name."""

    def resume(self) -> None:
        """It is about to run again, from wherever its program counter now stands."""

    def step(self, until_ns: int) -> bool:
        """Execute one instruction; False if it slept to `until_ns`, or has frames to send, first."""


class Line(Protocol):
    """The way to the debugger."""

    def receive(self, wait: bool) -> bytes:
        """What has come, b"" if nothing has and one is not to wait; raises Left when the debugger is gone."""

    def send(self, data: bytes) -> None:
        """Send; raises Left when the debugger is gone."""


class Left(Exception):
    """The debugger has detached, killed the ECU or gone away."""


class PowerCycle(Exception):
    """The debugger asked for a reset."""


class Onlooker(Watch):
    """Hears an ECU that answers when its debugger lets it."""

    def unanswered(self, t_ns: int) -> str | None:
        """Nothing is ever too late."""
        return None


class Powered(NamedTuple):
    """An ECU out of reset, and the machine in it."""

    ecu: Ecu
    machine: Machine


class Session:
    """An ECU, and the debugger at the other end of `line`.

    power_on gives a fresh ECU in reset, at the start and whenever the debugger asks for one. The ECU begins
    halted.
    """

    def __init__(self, power_on: Callable[[], Powered], line: Line) -> None:
        self._power_on = power_on
        self._line = line
        self._cycled = False
        self._halt: Stop | None = None
        self._sent = self._received = 0
        self._ecu, self._machine = power_on()
        self._stub = Stub(self._machine, self._commands())
        self.name = self._ecu.name

    def power_cycle(self) -> None:
        """Begin again with a fresh ECU, halted in reset."""
        self._sent = self._received = 0
        self._ecu, self._machine = self._power_on()
        self._stub.machine, self._stub.commands = self._machine, self._commands()

    def advance(self, t_ns: int) -> Transmission | None:
        """As `Ecu.advance`, halted as often and as long as the debugger likes.

        Raises Left and PowerCycle when the debugger ends this ECU's life.
        """
        while True:
            if self._halt:
                self._line.send(self._stub.stopped(self._halt))
                self._halt = None
            if self._stub.want is Want.HALT:
                self._talk()
            machine = self._machine
            try:
                if self._stub.want is Want.STEP:
                    if machine.step(t_ns):
                        self._halt = Stop(TRAPPED, machine.hit)
                    until_ns = machine.now_ns
                else:
                    until_ns = min(t_ns, machine.now_ns + SLICE_NS)
                request = self._ecu.advance(until_ns)
                if machine.hit:
                    self._halt = Stop(TRAPPED, machine.hit)
            except FirmwareFault as fault:
                self._halt = Stop(FAULTED, text=f"{fault.side}: {fault}\n")
                continue
            if not self._halt:
                self._listen()
            if request:
                self._sent += 1
                return request
            if machine.now_ns >= t_ns:
                return None  # a halt at this very instant comes with the next one's call

    def receive(self, frame: Frame, t_ns: int) -> None:
        """As `Ecu.receive`."""
        self._received += 1
        self._ecu.receive(frame, t_ns)

    def sent(self, handle: int, t_ns: int) -> None:
        """As `Ecu.sent`."""
        self._ecu.sent(handle, t_ns)

    def where(self) -> str:
        """As `Ecu.where`."""
        return self._ecu.where()

    def _talk(self) -> None:
        """Answer the debugger until it lets the machine go."""
        while self._stub.want is Want.HALT:
            self._line.send(self._stub.receive(self._line.receive(wait=True)))
            if self._cycled:
                self._cycled = False
                raise PowerCycle
        if self._stub.want in (Want.DETACH, Want.KILL):
            raise Left
        self._machine.resume()

    def _listen(self) -> None:
        """Whether the debugger interrupts the running machine."""
        data = self._line.receive(wait=False)
        if data:
            self._line.send(self._stub.receive(data))
        if self._stub.interrupted:
            self._halt = Stop(INTERRUPTED)

    def _commands(self) -> Mapping[str, Callable[[], str]]:
        return {**self._machine.reports, "frames": self._frames, "reset": self._reset}

    def _frames(self) -> str:
        return f"{self._received} frames came over the bus, {self._sent} were requested"

    def _reset(self) -> str:
        self._cycled = True
        return "power cycled; to GDB the registers change with: maintenance flush register-cache"


def silent_bus(ecu: Ecu, t_ns: int, period_ns: int = SLICE_NS) -> NoReturn:
    """Let `ecu` live from `t_ns` on a bus where nobody speaks, and every frame is acknowledged at once."""
    while True:
        t_ns += period_ns
        requests = []
        while request := ecu.advance(t_ns):
            requests.append(request)
        for request in requests:
            ecu.sent(request.handle, t_ns)

"""What GDB asks and what it is answered: one debugger, one core, one thread. Sans-I/O.

Bytes from the debugger go in, bytes for it come out. The machine is read and written at once; when it is to
run, `want` says so, and `stopped` tells the debugger how that ended. Nothing the debugger sends raises:
what cannot be understood is answered with an empty packet, what cannot be done with E01.

Source: Debugging with GDB, appendix E "GDB Remote Serial Protocol".
"""

import re
from collections import deque
from collections.abc import Callable, Mapping
from enum import Enum, auto
from typing import NamedTuple, Protocol

from bench.gdb.description import REGISTERS, Register, target_xml
from bench.gdb.wire import Decoder, Event, Mark, Packet, encode

PACKET_SIZE = 0x4000
THREAD = "1"

INTERRUPTED, TRAPPED, FAULTED = 2, 5, 11
"""Signal numbers as GDB counts them: SIGINT, SIGTRAP, SIGSEGV."""

POINTS = {"0": "break", "1": "break", "2": "write", "3": "read", "4": "access"}
"""Types of Z packets. A breakpoint is the machine's either way: none is written into the program."""

_WATCHES = {"write": "watch", "read": "rwatch", "access": "awatch"}
_HEX = re.compile(rb"[0-9a-fA-F]+\Z")
_SUPPORTED = b"PacketSize=%x;qXfer:features:read+;vContSupported+;QStartNoAckMode+" % PACKET_SIZE


class Want(Enum):
    """What the debugger wants of the machine now; while it HALTs, packets are answered."""

    HALT = auto()
    STEP = auto()
    RUN = auto()
    DETACH = auto()
    KILL = auto()


class Stop(NamedTuple):
    """Why the machine halted: the signal, the point that was hit, and a line for the debugger's console."""

    signal: int
    point: tuple[str, int] | None = None
    text: str = ""


class Debuggee(Protocol):
    """The halted machine, as the stub needs it."""

    def registers(self) -> Mapping[str, int]:
        """The values of all of `description.REGISTERS`, by name."""

    def write_register(self, name: str, value: int) -> None:
        """Set a register."""

    def read_memory(self, address: int, count: int) -> bytes:
        """Up to `count` bytes from `address` on: as many as are readable."""

    def write_memory(self, address: int, data: bytes) -> bool:
        """Whether all of `data` could be written."""

    def insert(self, kind: str, address: int, length: int) -> bool:
        """Halt at `address` (break), or after access to it (write, read, access); False if that cannot be."""

    def remove(self, kind: str, address: int, length: int) -> bool:
        """Take back an `insert`."""


class _Malformed(Exception):
    """A packet whose arguments make no sense."""


class Stub:
    """The debugger's counterpart for `machine`.

    machine, commands: may be exchanged while it is halted. commands: what answers `monitor NAME`, by name.
    want: what the debugger wants of the machine. interrupted: it asked a running machine to halt.
    """

    def __init__(self, machine: Debuggee, commands: Mapping[str, Callable[[], str]]) -> None:
        self.machine = machine
        self.commands = commands
        self._decoder = Decoder()
        self._waiting: deque[Event] = deque()
        self._acknowledge = True
        self._last = b""
        self._stop = Stop(TRAPPED)
        self.want = Want.HALT
        self.interrupted = False

    def receive(self, data: bytes) -> bytes:
        """Take what the debugger sent; what to send back."""
        self._waiting += self._decoder.feed(data)
        return self._work()

    def stopped(self, stop: Stop) -> bytes:
        """The machine has halted for `stop`; what to send."""
        self._stop = stop
        self.want = Want.HALT
        self.interrupted = False
        note = encode(b"O" + stop.text.encode().hex().encode()) if stop.text else b""
        self._last = encode(_stop_reply(stop))
        return note + self._last + self._work()

    def _work(self) -> bytes:
        """Answer what waits, as long as the machine is halted; a running one only hears the interrupt."""
        out = bytearray()
        while self._waiting and self.want is Want.HALT:
            event = self._waiting.popleft()
            if isinstance(event, Packet):
                out += self._packet(event.data)
            elif event is Mark.NAK:
                out += self._last
            elif event is Mark.DAMAGED and self._acknowledge:
                out += b"-"
        if self.want is not Want.HALT and Mark.INTERRUPT in self._waiting:
            self._waiting.remove(Mark.INTERRUPT)
            self.interrupted = True
        return bytes(out)

    def _packet(self, data: bytes) -> bytes:
        acknowledged = b"+" if self._acknowledge else b""
        try:
            answer = self._answer(data)
        except _Malformed:
            answer = b"E01"
        if answer is None:
            return acknowledged
        self._last = encode(answer)
        return acknowledged + self._last

    def _answer(self, data: bytes) -> bytes | None:
        """The reply to a packet: b'' if it is not understood, None if none is due now."""
        if data in _PLAIN:
            return _PLAIN[data]
        for prefix, handler in _HANDLERS:
            if data.startswith(prefix):
                return handler(self, data[len(prefix) :])
        return b""

    # Registers

    def _read_all(self, _: bytes) -> bytes:
        values = self.machine.registers()
        return b"".join(_little(register, values[register.name]) for register in REGISTERS)

    def _write_all(self, rest: bytes) -> bytes:
        values = _bytes(rest)
        if len(values) != sum(register.bits for register in REGISTERS) // 8:
            raise _Malformed
        at = 0
        for register in REGISTERS:
            size = register.bits // 8
            self.machine.write_register(register.name, int.from_bytes(values[at : at + size], "little"))
            at += size
        return b"OK"

    def _read_one(self, rest: bytes) -> bytes:
        register = _numbered(rest)
        return _little(register, self.machine.registers()[register.name])

    def _write_one(self, rest: bytes) -> bytes:
        number, _, value = rest.partition(b"=")
        register, content = _numbered(number), _bytes(value)
        if len(content) != register.bits // 8:
            raise _Malformed
        self.machine.write_register(register.name, int.from_bytes(content, "little"))
        return b"OK"

    # Memory

    def _read_memory(self, rest: bytes) -> bytes:
        address, count = _numbers(rest, 2)
        data = self.machine.read_memory(address, min(count, PACKET_SIZE // 2 - 4))
        return data.hex().encode() if data or not count else b"E01"

    def _write_memory(self, rest: bytes) -> bytes:
        span, _, content = rest.partition(b":")
        return self._store(span, _bytes(content))

    def _write_binary(self, rest: bytes) -> bytes:
        span, _, content = rest.partition(b":")
        return self._store(span, content)

    def _store(self, span: bytes, content: bytes) -> bytes:
        address, count = _numbers(span, 2)
        if count != len(content):
            raise _Malformed
        return b"OK" if not count or self.machine.write_memory(address, content) else b"E01"

    # Running

    def _continue(self, rest: bytes) -> None:
        self._resume(Want.RUN, rest)

    def _step(self, rest: bytes) -> None:
        self._resume(Want.STEP, rest)

    def _signal_continue(self, rest: bytes) -> None:
        self._resume(Want.RUN, rest.partition(b";")[2])

    def _signal_step(self, rest: bytes) -> None:
        self._resume(Want.STEP, rest.partition(b";")[2])

    def _resume(self, want: Want, address: bytes) -> None:
        if address:
            self.machine.write_register("pc", _number(address))
        self.want = want

    def _actions(self, rest: bytes) -> bytes | None:
        """The first action that names our thread, or none, is the one (a signal means nothing to an MCU)."""
        for action in rest.split(b";"):
            kind, _, thread = action.partition(b":")
            if thread in (b"", b"-1", b"0", THREAD.encode()):
                wants = {b"c": Want.RUN, b"C": Want.RUN, b"s": Want.STEP, b"S": Want.STEP}
                if kind[:1] not in wants:
                    raise _Malformed
                self.want = wants[kind[:1]]
                return None
        raise _Malformed

    def _kill(self, _: bytes) -> None:
        self.want = Want.KILL

    def _polite_kill(self, _: bytes) -> bytes:
        self.want = Want.KILL
        return b"OK"

    def _detach(self, _: bytes) -> bytes:
        self.want = Want.DETACH
        return b"OK"

    def _why(self, _: bytes) -> bytes:
        return _stop_reply(self._stop)

    # Break- and watchpoints

    def _insert(self, rest: bytes) -> bytes:
        return self._point(rest, self.machine.insert)

    def _remove(self, rest: bytes) -> bytes:
        return self._point(rest, self.machine.remove)

    def _point(self, rest: bytes, change: Callable[[str, int, int], bool]) -> bytes:
        number, _, span = rest.partition(b",")
        kind = POINTS.get(number.decode("latin-1"))
        if kind is None:
            return b""
        # What follows a semicolon are conditions, which were not announced.
        address, length = _numbers(span.partition(b";")[0], 2)
        return b"OK" if change(kind, address, length) else b"E01"

    # About the stub and the machine

    def _no_acknowledgement(self, _: bytes) -> bytes:
        self._acknowledge = False
        return b"OK"

    def _features(self, rest: bytes) -> bytes:
        offset, count = _numbers(rest, 2)
        whole = target_xml()
        part = whole[offset : offset + min(count, PACKET_SIZE // 2)]
        return (b"m" if offset + len(part) < len(whole) else b"l") + part

    def _monitor(self, rest: bytes) -> bytes:
        name = _bytes(rest).decode("utf-8", "replace").strip()
        command = self.commands.get(name)
        answer = command() if command else f"no command {name!r}; there are {', '.join(self.commands)}"
        return (answer + "\n").encode().hex().encode()


_PLAIN = {
    b"vCont?": b"vCont;c;C;s;S",
    b"qAttached": b"1",  # so that a GDB that quits detaches
    b"qC": f"QC{THREAD}".encode(),
    b"qfThreadInfo": f"m{THREAD}".encode(),
    b"qsThreadInfo": b"l",
    b"qSymbol::": b"OK",
    b"qSupported": _SUPPORTED,
}
"""Questions with one answer."""

_HANDLERS: tuple[tuple[bytes, Callable[[Stub, bytes], bytes | None]], ...] = (
    (b"?", Stub._why),
    (b"g", Stub._read_all),
    (b"G", Stub._write_all),
    (b"p", Stub._read_one),
    (b"P", Stub._write_one),
    (b"m", Stub._read_memory),
    (b"M", Stub._write_memory),
    (b"X", Stub._write_binary),
    (b"c", Stub._continue),
    (b"s", Stub._step),
    (b"C", Stub._signal_continue),
    (b"S", Stub._signal_step),
    (b"vCont;", Stub._actions),
    (b"vKill", Stub._polite_kill),
    (b"k", Stub._kill),
    (b"D", Stub._detach),
    (b"Z", Stub._insert),
    (b"z", Stub._remove),
    (b"H", lambda stub, rest: b"OK"),
    (b"T", lambda stub, rest: b"OK"),
    (b"QStartNoAckMode", Stub._no_acknowledgement),
    (b"qSupported:", lambda stub, rest: _SUPPORTED),
    (b"qXfer:features:read:target.xml:", Stub._features),
    (b"qRcmd,", Stub._monitor),
)
"""What other packets begin with, and who answers them; the first that fits."""


def _stop_reply(stop: Stop) -> bytes:
    reason = (
        f"{_WATCHES[stop.point[0]]}:{stop.point[1]:x};" if stop.point and stop.point[0] in _WATCHES else ""
    )
    return f"T{stop.signal:02x}{reason}thread:{THREAD};".encode()


def _little(register: Register, value: int) -> bytes:
    return value.to_bytes(register.bits // 8, "little").hex().encode()


def _number(text: bytes) -> int:
    if not _HEX.match(text) or len(text) > 16:
        raise _Malformed
    return int(text, 16)


def _numbers(text: bytes, count: int) -> list[int]:
    parts = text.split(b",")
    if len(parts) != count:
        raise _Malformed
    return [_number(part) for part in parts]


def _numbered(text: bytes) -> Register:
    number = _number(text)
    if number >= len(REGISTERS):
        raise _Malformed
    return REGISTERS[number]


def _bytes(text: bytes) -> bytes:
    if len(text) % 2 or (text and not _HEX.match(text)):
        raise _Malformed
    return bytes.fromhex(text.decode())

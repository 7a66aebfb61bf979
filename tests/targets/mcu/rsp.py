"""The debugger's side of GDB's remote protocol, for tests: one packet out, one reply in."""

from collections.abc import Callable

from bench.gdb.stub import TRAPPED, Stop, Stub, Want
from bench.gdb.wire import Decoder, Packet, encode
from targets.mcu.debugger import Debugger
from targets.mcu.machine import Stm32f405

CHUNK = 1024
"""Bytes of memory to a packet; QEMU's hold twice as many."""

PATIENCE_NS = 3600 * 1_000_000_000
"""Of the emulated machine: what runs for longer will not come to its breakpoint."""


class Client:
    """Talks to a stub through `exchange`, which sends bytes and returns some that came back, or b"".

    Registers are named by their number in the `g` packet of an M-profile core: 0 to 15, r0 to pc.
    """

    def __init__(self, exchange: Callable[[bytes], bytes]) -> None:
        self._exchange = exchange
        self._decoder = Decoder()
        self._breakpoints: set[int] = set()

    def ask(self, request: bytes) -> bytes:
        """The reply to `request`; console output that comes before a stop reply is passed over."""
        out = encode(request)
        while True:
            for event in self._decoder.feed(self._exchange(out)):
                if isinstance(event, Packet) and (not event.data.startswith(b"O") or event.data == b"OK"):
                    self._exchange(b"+")
                    return event.data
            out = b""

    def do(self, request: bytes) -> None:
        """A request that is to be answered with OK."""
        reply = self.ask(request)
        assert reply == b"OK", f"{request!r} was answered with {reply!r}"

    def read(self, address: int, count: int) -> bytes:
        data = b""
        for k in range(0, count, CHUNK):
            data += bytes.fromhex(self.ask(b"m%x,%x" % (address + k, min(CHUNK, count - k))).decode())
        assert len(data) == count
        return data

    def write(self, address: int, data: bytes) -> None:
        for k in range(0, len(data), CHUNK):
            part = data[k : k + CHUNK]
            self.do(b"M%x,%x:%b" % (address + k, len(part), part.hex().encode()))

    def register(self, number: int) -> int:
        return int.from_bytes(bytes.fromhex(self.ask(b"p%x" % number).decode()), "little")

    def set_register(self, number: int, value: int) -> None:
        self.do(b"P%x=%b" % (number, value.to_bytes(4, "little").hex().encode()))

    def run_to(self, address: int) -> None:
        """Continue until the program is about to execute `address`; the breakpoint there stays."""
        if address not in self._breakpoints:
            self.do(b"Z1,%x,2" % address)
            self._breakpoints.add(address)
        reply = self.ask(b"vCont;c")
        assert reply.startswith(b"T05"), reply
        assert self.register(15) == address

    def call(self, function: int, *arguments: int, back: int) -> int:
        """Call the function at `function` with up to four arguments, to return to `back`: its r0."""
        for number, argument in enumerate(arguments):
            self.set_register(number, argument)
        self.set_register(14, back | 1)
        self.set_register(15, function)
        self.run_to(back)
        return self.register(0)


def connect(mcu: Stm32f405) -> Client:
    """A debugger's connection to our own machine, which runs by itself, on no bus."""
    probe = Debugger(mcu)
    stub = Stub(probe, {})

    def exchange(data: bytes) -> bytes:
        out = stub.receive(data)
        if stub.want is Want.RUN:
            probe.resume()
            mcu.run(probe.now_ns + PATIENCE_NS)
            out += stub.stopped(Stop(TRAPPED, probe.hit))
        return out

    return Client(exchange)

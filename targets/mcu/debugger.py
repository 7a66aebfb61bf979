"""What a debugger can do with the machine: registers, memory, steps, break- and watchpoints, a few reports.

It looks and pokes from outside, as a probe does on the debug port: time stands still meanwhile, and nothing
is written into the program. Belongs here: what is possible. Never: a debugger's protocol.
"""

from collections.abc import Callable, Mapping
from typing import Any

from targets.errors import FirmwareError
from targets.mcu import state, traps
from targets.mcu.machine import BREAKPOINT, STEP, Stm32f405

PAGE = 4096
_DEVICES = 0x40000000
_WIDEST = 8
"""Bytes that an instruction reads or writes at once, at most."""

_M32 = 0xFFFFFFFF
_RCC_APB1ENR = 0x40023840
_CONTROLLERS = {"CAN1": (25, 0x40006400), "CAN2": (26, 0x40006800)}
"""Bit of the clock's enable (RM0090 7.3.13), and address."""

_ERRORS = (
    "none",
    "stuff",
    "form",
    "acknowledgment",
    "recessive bit",
    "dominant bit",
    "CRC",
    "set by software",
)
"""Last error code of bxCAN's ESR (RM0090 32.9.2)."""

Point = tuple[str, int, int]
"""Kind (break, write, read, access), address, length."""


class Debugger:
    """A debug probe on `mcu`, which is halted whenever its `run` is not being executed."""

    def __init__(self, mcu: Stm32f405) -> None:
        self.mcu = mcu
        # with the engine's hook of a watchpoint, 0 for a breakpoint
        self._points: list[tuple[Point, int]] = []
        self._caught: tuple[str, int] | None = None
        self._resumed = (-1, -1)  # program counter and cycles
        mcu.state[state.HALT_ON_BKPT] = 1

    @property
    def now_ns(self) -> int:
        """The instant the machine has reached."""
        return self.mcu.now_ns

    @property
    def hit(self) -> tuple[str, int] | None:
        """Kind and address of the point at which the machine has halted since `resume`, None if at none."""
        if self._caught:
            return self._caught
        S, pc = self.mcu.state, self.mcu.pc
        # A run may end at a breakpoint without knowing it, because its time was up there.
        asleep, moved = S[state.SLEEPING], self._resumed != (pc, self.mcu.cycles)
        at_break = any(kind == "break" and address & ~1 == pc for (kind, address, _), _ in self._points)
        return ("break", pc) if self._at_bkpt() or (at_break and moved and not asleep) else None

    def _at_bkpt(self) -> bool:
        """Whether a BKPT in the program halted the machine."""
        S = self.mcu.state
        return bool(S[state.STOPPED] == traps.AT_INTERRUPT and S[state.TRAP] == traps.BKPT)

    def resume(self) -> None:
        """The machine is about to run again: what it halted for is past, also a fault or a BKPT."""
        S = self.mcu.state
        if self._at_bkpt():
            self.mcu.set_register("pc", self.mcu.pc + 2)
        self._caught = None
        self._resumed = (self.mcu.pc, self.mcu.cycles)
        S[state.STOPPED] = S[state.ERROR] = 0

    def step(self, until_ns: int) -> bool:
        """Execute one instruction; False if the machine slept to `until_ns`, or has frames to send, first.

        An IT block is one instruction.
        """
        return self.mcu.step(until_ns) in (STEP, BREAKPOINT)

    # Registers and memory

    def registers(self) -> dict[str, int]:
        """r0 to r12, sp, lr, pc, xpsr, msp, psp, primask, basepri, faultmask, control, d0 to d15, fpscr."""
        values = self.mcu.registers()
        doubles = {f"d{k}": values[f"s{2 * k}"] | values[f"s{2 * k + 1}"] << 32 for k in range(16)}
        # CONTROL has three bits; the engine's others are ARMv8-M's.
        return values | doubles | {"control": values["control"] & 7}

    def write_register(self, name: str, value: int) -> None:
        """Set one of `registers`."""
        if name.startswith("d"):
            single = 2 * int(name[1:])
            self.mcu.set_register(f"s{single}", value & _M32)
            self.mcu.set_register(f"s{single + 1}", value >> 32)
        else:
            self.mcu.set_register(name, value)
            if name == "pc":
                self.mcu.state[state.STOPPED] = 0  # no longer at a BKPT

    def read_memory(self, address: int, count: int) -> bytes:
        """Up to `count` bytes of memory or devices, as far as something answers there."""
        data = b""
        while len(data) < count and address <= _M32:
            size = min(count - len(data), PAGE - address % PAGE)
            try:
                data += self.mcu.read_memory(address, size)
            except FirmwareError:
                break
            address += size
        return data

    def write_memory(self, address: int, data: bytes) -> bool:
        """Write memory, flash included, or devices; False if something lies outside both."""
        if address + len(data) - 1 > _M32:
            return False
        try:
            self.mcu.write_memory(address, data)
        except FirmwareError:
            return False
        return True

    # Break- and watchpoints

    def insert(self, kind: str, address: int, length: int) -> bool:
        """Halt before the instruction at `address`, or after one that accesses memory there."""
        point = (kind, address, length)
        if kind == "break":
            self._points.append((point, 0))
            self._set_breakpoints()
            return True
        # The engine calls no hook for devices.
        if address + length > _DEVICES or not self.read_memory(address, 1):
            return False
        self._points.append((point, self._watch(kind, address, length)))
        return True

    def remove(self, kind: str, address: int, length: int) -> bool:
        """Take back an `insert`; False if there was none."""
        for entry in self._points:
            if entry[0] == (kind, address, length):
                self._points.remove(entry)
                if kind == "break":
                    self._set_breakpoints()
                else:
                    self.mcu._engine.hook_del(entry[1])
                return True
        return False

    def _set_breakpoints(self) -> None:
        self.mcu.set_breakpoints(address for (kind, address, _), _ in self._points if kind == "break")

    def _watch(self, kind: str, address: int, length: int) -> int:
        from unicorn import UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE

        accesses = {
            "write": UC_HOOK_MEM_WRITE,
            "read": UC_HOOK_MEM_READ,
            "access": UC_HOOK_MEM_READ | UC_HOOK_MEM_WRITE,
        }[kind]
        S = self.mcu.state

        def on_access(engine: Any, access: int, at: int, size: int, value: int, user: Any) -> None:
            if at + size > address:
                self._caught = (kind, address)
                S[state.STOPPED] = traps.AT_BREAKPOINT
                engine.emu_stop()

        # The engine looks only at where an access begins.
        first = max(address - _WIDEST + 1, 0)
        return int(self.mcu._engine.hook_add(accesses, on_access, None, first, address + length - 1))

    # Reports

    @property
    def reports(self) -> Mapping[str, Callable[[], str]]:
        """What the machine can say about itself, by name."""
        return {"time": self._time, "cycles": self._cycles, "can": self._can, "unmodelled": self._unmodelled}

    def _time(self) -> str:
        return f"{self.now_ns / 1e9:.9f} s"

    def _cycles(self) -> str:
        return f"{self.mcu.cycles} cycles, now at {self.mcu.hz / 1e6:g} MHz"

    def _can(self) -> str:
        clocked = self._word(_RCC_APB1ENR)
        return "\n".join(
            self._controller(name, base) if clocked >> bit & 1 else f"{name}: without a clock"
            for name, (bit, base) in _CONTROLLERS.items()
        )

    def _controller(self, name: str, base: int) -> str:
        """The registers of a bxCAN in words (RM0090 32.9.2)."""
        msr, tsr, rf0, rf1, esr, btr = (self._word(base + offset) for offset in (4, 8, 0xC, 0x10, 0x18, 0x1C))
        mode = "initialisation" if msr & 1 else "sleep" if msr & 2 else "normal"
        if esr & 4:
            mode += ", bus-off"
        quanta = 3 + (btr >> 16 & 0xF) + (btr >> 20 & 7)
        waiting = 3 - (tsr >> 26 & 7).bit_count()
        overrun = " (overrun)" if (rf0 | rf1) & 0x10 else ""
        return (
            f"{name}: {mode}; a bit is {quanta} quanta of {(btr & 0x3FF) + 1} APB1 clocks; "
            f"{waiting} frames to send, {rf0 & 3} and {rf1 & 3} received{overrun}; error counts "
            f"{esr >> 16 & 0xFF} transmit, {esr >> 24} receive, last error {_ERRORS[esr >> 4 & 7]}"
        )

    def _word(self, address: int) -> int:
        return int.from_bytes(self.mcu.read_memory(address, 4), "little")

    def _unmodelled(self) -> str:
        lines = [f"{address:#010x}  {count}" for address, count in self.mcu.unmodelled().items()]
        return "\n".join(["register    accesses", *lines]) if lines else "no unmodelled register was accessed"

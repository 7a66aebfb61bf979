"""Calling one function of a firmware as a debugger would: arguments in, cycles and results out.

The function finds what start-up code would have prepared: its data at their link addresses, a stack, the FPU
on. Time runs from its first instruction to its return, the returning branch included.
"""

from collections.abc import Sequence
from typing import NamedTuple

from targets.errors import FirmwareError, FirmwareFault
from targets.mcu import art, blocks, clock, core, flash, native, state
from targets.mcu.dwarf import inside
from targets.mcu.image import Image
from targets.mcu.machine import TRANSMIT, Stm32f405
from targets.mcu.memory_map import CCM, CCM_SIZE, SRAM, SRAM1_END, SRAM_SIZE, holds

RETURN = 0x1F000000
"""Where the function returns to: reserved on the real MCU (RM0090 figure 1)."""

LIMIT_CYCLES = 1_000_000_000
CHUNK_CYCLES = 5_000_000
"""Emulated between two looks at whether the user wants no more."""

ART_ON = 0x700  # FLASH_ACR: prefetch and both caches enabled
FPU_ON = 0xF << 20  # CPACR: full access to CP10 and CP11
THUMB = 1 << 24
REGISTERS_IN_ARGUMENTS = 4


class Outcome(NamedTuple):
    """What one call did: cycles by the model and its two bounds, instructions, and the result registers."""

    cycles: int
    optimistic: int
    pessimistic: int
    instructions: int
    r0: int
    r1: int


class Caller:
    """An MCU at `hz` on which the functions of `image` can be called.

    wait_states: of the flash; above 0 its prefetch and caches are on. stack: the stack's top.
    """

    def __init__(self, image: Image, hz: int, wait_states: int = 0, stack: int = SRAM1_END) -> None:
        self.image = image
        self.mcu = Stm32f405(image)
        self._stack = stack
        for address, content in image.copied:
            self.mcu.engine.mem_write(address, content)
        self.mcu.engine.mem_map(RETURN, 4096, 5)  # to be read and executed
        self.mcu.engine.mem_write(RETURN, bytes.fromhex("fee7"))  # b .
        S = self.mcu.state
        S[state.CPACR] |= FPU_ON
        S[state.CALL_END] = RETURN
        flash.write(S, 0, wait_states | ART_ON if wait_states else 0)
        clock.set_hz(S, hz, S[state.CYCLES])
        self._before = S[: state.TIME].copy(), [(at, self.mcu.read_bytes(at, size)) for at, size in _RAM]

    def reload(self) -> None:
        """Bring memory and devices back to where they were before the first call."""
        devices, memories = self._before
        self.mcu.state[: state.TIME] = devices
        art.clear(self.mcu.state)
        for address, content in memories:
            self.mcu.engine.mem_write(address, content)
            self.mcu.engine.ctl_remove_cache(address, address + len(content))

    def call(self, symbol: str, arguments: Sequence[int], limit_cycles: int = LIMIT_CYCLES) -> Outcome:
        """Call the function `symbol` with 32-bit words (AAPCS: four in registers, the others on the stack).

        Raises FirmwareError if there is no such function, FirmwareFault if it did what only a fault handler
        could answer, or has not returned after `limit_cycles`.
        """
        mcu, S = self.mcu, self.mcu.state
        entry = function(self.image, symbol)
        self._enter(entry, arguments)
        begun = _counts(mcu)
        end = mcu.cycles + limit_cycles
        while mcu.pc != RETURN:
            if mcu.cycles >= end:
                asleep = "sleeps" if S[state.SLEEPING] else "has not returned"
                raise FirmwareFault(f"{symbol} {asleep} after {limit_cycles} cycles at {mcu.where()}")
            if mcu.run(clock.ns_of(S, min(end, mcu.cycles + CHUNK_CYCLES)) + 1) == TRANSMIT:
                S[state.CAN_TX_NEW] = 0  # there is no bus
        cycles, low, high, instructions = (now - at for now, at in zip(_counts(mcu), begun, strict=True))
        r0, r1 = (native.get_register(S, core.REG_R0 + k) & 0xFFFFFFFF for k in range(2))
        return Outcome(cycles, low, high, instructions, r0, r1)

    def dump(self, address: int, count: int) -> bytes:
        """Bytes of memory; FirmwareError if they do not lie in one."""
        if count < 1 or not holds(address, count):
            raise FirmwareError(f"{count} bytes at {address:#010x} do not lie in memory")
        return self.mcu.read_bytes(address, count)

    def _enter(self, entry: int, arguments: Sequence[int]) -> None:
        """Registers as at the first instruction: those that hold no argument are 0."""
        S = self.mcu.state
        stacked = arguments[REGISTERS_IN_ARGUMENTS:]
        sp = (self._stack - 4 * len(stacked)) & ~7
        for k, value in enumerate(stacked):
            self.mcu.engine.mem_write(sp + 4 * k, (value & 0xFFFFFFFF).to_bytes(4, "little"))
        in_registers = [*arguments[:REGISTERS_IN_ARGUMENTS], *([0] * 13)][:13]
        for k, value in enumerate(in_registers):
            native.set_register(S, core.REG_R0 + k, value & 0xFFFFFFFF)
        for k in range(32):
            native.set_register(S, core.REG_S0 + k, 0)
        native.set_register(S, core.REG_FPSCR, 0)
        native.set_register(S, core.REG_SP, sp)
        native.set_register(S, core.REG_LR, RETURN | 1)
        native.set_register(S, core.REG_XPSR, THUMB)
        S[state.SLEEPING] = 0
        S[state.PC] = entry
        S[state.THUMB] = 1
        blocks.restart(S)


def _counts(mcu: Stm32f405) -> tuple[int, ...]:
    """Cycles by the model and its bounds, and instructions, since power-on."""
    return mcu.cycles, *state.words(mcu.state, state.CYCLES_MIN, 3)


_RAM = ((SRAM, SRAM_SIZE), (CCM, CCM_SIZE))


def function(image: Image, symbol: str) -> int:
    """Address of the function `symbol`; FirmwareError if there is none that this core can execute."""
    address = image.symbol(symbol)
    if inside(image.arm_code, address):
        raise FirmwareError(f"{image.source}: {symbol} is in ARM state; a Cortex-M4 executes Thumb only")
    if not (is_function(image, address) or any(inside(s, address) for s in (image.code, image.ram_code))):
        raise FirmwareError(f"{image.source}: {symbol} at {address:#010x} is data, not code")
    return address


def is_function(image: Image, address: int) -> bool:
    """Whether a function begins at `address`."""
    return any(start == address for start, _ in image.functions)


def word(image: Image, text: str) -> int:
    """An argument: an integer that fits 32 bits, or &SYMBOL, &SYMBOL+OFFSET, &SYMBOL-OFFSET.

    The address of a function comes with its Thumb bit, as a C compiler would pass it.
    """
    if text.startswith("&"):
        address = place(image, text[1:])
        return address | 1 if is_function(image, address) else address
    value = _integer(text)
    if value is None:
        raise FirmwareError(f"argument {text!r} is neither an integer nor &symbol")
    if not -(1 << 31) <= value < 1 << 32:
        raise FirmwareError(f"argument {text} does not fit 32 bits")
    return value


def place(image: Image, text: str) -> int:
    """The address of SYMBOL, SYMBOL+OFFSET or SYMBOL-OFFSET."""
    if text in image.symbols:
        return image.symbols[text]
    for sign in "+-":
        name, found, offset = text.rpartition(sign)
        distance = _integer(offset)
        if found and distance is not None and name in image.symbols:
            return (image.symbols[name] + (distance if sign == "+" else -distance)) & 0xFFFFFFFF
    return image.symbol(text)


def _integer(text: str) -> int | None:
    for base in (0, 10):  # 10: leading zeros
        try:
            return int(text, base)
        except ValueError:
            continue
    return None

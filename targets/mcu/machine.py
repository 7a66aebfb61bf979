"""An STM32F405: unicorn, memories, devices and cycle model put together; time in nanoseconds from outside."""

import ctypes
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from targets.errors import FirmwareFault
from targets.mcu import blocks, bxcan, clock, core, cycles, native, peripherals, rcc, scs, state
from targets.mcu.image import Image
from targets.mcu.memory_map import ALIAS, CCM, CCM_SIZE, FLASH, SRAM, SRAM_SIZE

if TYPE_CHECKING:
    import unicorn

PAGE = 4096
CODE_SIZE = 0x100000
TRANSLATED_SIZE = 32 << 20
"""Room for translated code, bytes: a megabyte of flash many times over."""

_EXCEPTIONS = {
    1: "undefined instruction",
    2: "supervisor call without a handler",
    3: "instruction fetch outside memory",
    4: "data abort",
    7: "breakpoint instruction",
    18: "instruction in ARM state",
}
"""The engine's exception numbers that no handler of a firmware for this MCU takes here."""

TIME, TRANSMIT, FAULT, RESET = core.TIME, core.TRANSMIT, core.FAULT, core.RESET


class Stm32f405:
    """The emulated microcontroller with `image` in flash, in reset until the first `run`.

    power_on_ns: the instant at which the supply comes up, which may lie before 0.
    flash: uint8, the flash memory itself; what is written to it the program sees (code: see `patch`).
    """

    def __init__(self, image: Image, power_on_ns: int = 0) -> None:
        self.image = image
        self._watching: list[NDArray[np.int64]] = []
        self.flash = _aligned(CODE_SIZE, fill=0xFF)
        self.flash[: len(image.flash)] = np.frombuffer(image.flash, dtype=np.uint8)
        self._sram = _aligned(SRAM_SIZE)
        self._ccm = _aligned(CCM_SIZE)
        self.state = state.allocate(len(image.flash))
        self._engine = _engine(self)
        for address, content in image.ram:
            self._engine.mem_write(address, content)
        self._reset(power_on_ns)

    def _reset(self, t_ns: int) -> None:
        S = self.state
        figures = cycles.timing()
        costs = cycles.cumulated(self.image.flash, FLASH, list(self.image.code))
        S[state.COST : state.COST + len(costs)] = costs
        S[state.CODE_HALFWORDS] = len(costs) - 1
        S[state.BRANCH_PENALTY] = figures.branch_penalty
        S[state.ENTRY_CYCLES] = figures.exception_entry
        S[state.EXIT_CYCLES] = figures.exception_exit
        S[state.TAIL_CYCLES] = figures.tail_chain
        S[state.BASE_NS] = t_ns
        S[state.HZ] = rcc.HSI_HZ
        rcc.reset(S)
        bxcan.reset(S)
        scs.reset(S)
        S[state.VTOR] = vectors = self.image.vectors or FLASH
        stack, entry = (self.read_word(vectors + offset) for offset in (0, 4))
        native.set_register(S, core.REG_SP, stack)
        native.set_register(S, core.REG_LR, 0xFFFFFFFF)
        S[state.PC] = S[state.NEXT] = entry & ~1

    def run(self, until_ns: int) -> int:
        """Run until `until_ns`; TIME, or TRANSMIT earlier if a mailbox asks for the bus.

        Raises FirmwareFault if the program did what only a fault handler could answer.
        """
        self.state[state.UNTIL_NS] = until_ns
        reason = int(core.run(self.state))
        if reason == FAULT:
            raise FirmwareFault(f"{self._fault()} at {self.where()}")
        if reason == RESET:
            raise FirmwareFault(f"the firmware asked for a system reset at {self.where()}")
        return reason

    @property
    def now_ns(self) -> int:
        """The instant the CPU has reached."""
        return int(clock.now_ns(self.state))

    @property
    def hz(self) -> int:
        """The CPU's clock as the firmware has set it."""
        return int(self.state[state.HZ])

    @property
    def cycles(self) -> int:
        """CPU cycles since power-on."""
        return int(self.state[state.CYCLES])

    @property
    def pc(self) -> int:
        """The program counter."""
        return int(self.state[state.PC])

    def where(self) -> str:
        """The program counter, the function it is in, and the source line."""
        name, line = self.image.function_at(self.pc), self.image.line_at(self.pc)
        return f"pc {self.pc:#010x}" + (f" in {name}" if name else "") + (f" ({line})" if line else "")

    def unmodelled(self) -> dict[int, int]:
        """Addresses of registers that were accessed and are not modelled: address -> times."""
        S = self.state
        count = int(S[state.UNMODELLED])
        pairs = state.words(S, state.UNMODELLED + 1, 2 * count)
        return dict(zip(pairs[::2], pairs[1::2], strict=True))

    def read_word(self, address: int) -> int:
        """A 32-bit word of memory (not of devices)."""
        return int.from_bytes(self._engine.mem_read(address, 4), "little")

    def read_bytes(self, address: int, count: int) -> bytes:
        """Bytes of memory (not of devices)."""
        return bytes(self._engine.mem_read(address, count))

    @property
    def engine(self) -> "unicorn.Uc":
        """Unicorn itself, for memory beside that of the real MCU."""
        return self._engine

    def watch_blocks(self, callback: int, memory: NDArray[np.int64]) -> None:
        """Have the C function at `callback` called for each basic block, too, once its time is charged.

        memory: what it is given; it is kept as long as the machine.
        """
        import unicorn
        from unicorn.unicorn_py3 import unicorn as binding

        self._watching.append(memory)
        user = ctypes.c_void_p(memory.ctypes.data)
        _hook(binding.uclib, self._engine, unicorn.UC_HOOK_BLOCK, callback, user)

    def patch(self, address: int, data: bytes) -> None:
        """Write to flash as a debugger would: code that has been translated already is forgotten."""
        at = address - FLASH
        self.flash[at : at + len(data)] = np.frombuffer(data, dtype=np.uint8)
        for start in (address, address - FLASH + ALIAS):
            self._engine.ctl_remove_cache(start, start + len(data))

    def _fault(self) -> str:
        import unicorn

        code = int(self.state[state.ERROR])
        number, kind = code >> 16, code & 0xFFFF
        if kind == core.ERROR_INTERRUPT:
            return _EXCEPTIONS.get(number, f"exception {number}")
        if kind == core.ERROR_STACK:
            return "exception frame outside memory"
        return str(unicorn.UcError(kind)).split(" (UC_ERR")[0].lower()


def _aligned(size: int, fill: int = 0) -> NDArray[np.uint8]:
    """A page-aligned byte array of whole pages."""
    raw = np.full(size + PAGE, fill, dtype=np.uint8)
    offset = -raw.ctypes.data % PAGE
    return raw[offset : offset + size]


def _engine(mcu: Stm32f405) -> "unicorn.Uc":
    import unicorn
    from unicorn import arm_const
    from unicorn.unicorn_py3 import unicorn as binding

    library = binding.uclib
    uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    uc.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M4)
    # By itself the engine reserves a gigabyte of addresses, and ends the process where it may not.
    uc.ctl_set_tcg_buffer_size(TRANSLATED_SIZE)
    rx, rw = unicorn.UC_PROT_READ | unicorn.UC_PROT_EXEC, unicorn.UC_PROT_READ | unicorn.UC_PROT_WRITE
    for address, memory, access in (
        (FLASH, mcu.flash, rx),
        (ALIAS, mcu.flash, rx),
        (SRAM, mcu._sram, rw | unicorn.UC_PROT_EXEC),
        (CCM, mcu._ccm, rw),
    ):
        uc.mem_map_ptr(address, len(memory), access, memory.ctypes.data)
    S = mcu.state
    native.bind(S, ctypes.cast(uc._uch, ctypes.c_void_p).value or 0, library)
    user = ctypes.c_void_p(state.as_pointer(S))
    for base, size, read, write in (
        (
            peripherals.PERIPHERALS,
            peripherals.PERIPHERALS_SIZE,
            peripherals.on_peripheral_read,
            peripherals.on_peripheral_write,
        ),
        (
            peripherals.SYSTEM,
            peripherals.SYSTEM_SIZE,
            peripherals.on_system_read,
            peripherals.on_system_write,
        ),
    ):
        _checked(
            library.uc_mmio_map(
                uc._uch, base, size, ctypes.c_void_p(read.address), user, ctypes.c_void_p(write.address), user
            )
        )
    _hook(library, uc, unicorn.UC_HOOK_BLOCK, blocks.on_block.address, user)
    _hook(library, uc, unicorn.UC_HOOK_INTR, core.on_interrupt.address, user)
    return uc


def _hook(library: ctypes.CDLL, uc: "unicorn.Uc", kind: int, address: int, user: ctypes.c_void_p) -> None:
    handle = ctypes.c_size_t()
    _checked(library.uc_hook_add(uc._uch, ctypes.byref(handle), kind, ctypes.c_void_p(address), user, 1, 0))


def _checked(error: int) -> None:
    if error:
        import unicorn

        raise RuntimeError(f"the emulator refused its set-up: {unicorn.UcError(error)}")

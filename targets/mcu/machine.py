"""An STM32F405: unicorn, memories, devices and cycle model put together; time in nanoseconds from outside."""

import ctypes
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from targets.errors import FirmwareFault
from targets.mcu import blocks, bxcan, clock, core, cycles, native, rcc, records, regions, resets, scs, state
from targets.mcu.image import FLASH, Image

if TYPE_CHECKING:
    import unicorn

PAGE = 4096
SRAM, SRAM_SIZE = 0x20000000, 0x20000  # SRAM1 and SRAM2, 128 kB
CCM, CCM_SIZE = 0x10000000, 0x10000  # core-coupled memory, 64 kB
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
        self.flash = _aligned(CODE_SIZE, fill=0xFF)
        self.flash[: len(image.flash)] = np.frombuffer(image.flash, dtype=np.uint8)
        self._sram = _aligned(SRAM_SIZE)
        self._ccm = _aligned(CCM_SIZE)
        self.state = state.allocate(len(image.flash))
        self.state[state.SRAM_HOST] = self._sram.ctypes.data
        self._records = records.attach(self.state)
        self._engine = _engine(self)
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
        resets.reset_all(S)
        bxcan.reset(S)
        scs.reset(S)
        stack, entry = (self.read_word(FLASH + offset) for offset in (0, 4))
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
        """The program counter and the function it is in."""
        name = self.image.function_at(self.pc)
        return f"pc {self.pc:#010x}" + (f" in {name}" if name else "")

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

    def patch(self, address: int, data: bytes) -> None:
        """Write to flash as a debugger would: code that has been translated already is forgotten."""
        at = address - FLASH
        self.flash[at : at + len(data)] = np.frombuffer(data, dtype=np.uint8)
        self._engine.ctl_remove_cache(address, address + len(data))

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
        (SRAM, mcu._sram, rw | unicorn.UC_PROT_EXEC),
        (CCM, mcu._ccm, rw),
    ):
        uc.mem_map_ptr(address, len(memory), access, memory.ctypes.data)
    S = mcu.state
    native.bind(S, ctypes.cast(uc._uch, ctypes.c_void_p).value or 0, library)
    user = ctypes.c_void_p(state.as_pointer(S))
    read, write = (ctypes.c_void_p(f.address) for f in (regions.on_read, regions.on_write))
    for k, (base, size) in enumerate(regions.REGIONS):
        region = ctypes.c_void_p(regions.user_data(S, k))
        _checked(library.uc_mmio_map(uc._uch, base, size, read, region, write, region))
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

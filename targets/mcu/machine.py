"""An STM32F405: unicorn, memories, devices and cycle model put together; time in nanoseconds from outside."""

import ctypes
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from targets.errors import FirmwareError, FirmwareFault
from targets.mcu import (
    attention,
    blocks,
    bxcan,
    clock,
    core,
    diagnosis,
    dynamic,
    faults,
    identity,
    native,
    peripherals,
    pipeline,
    preemption,
    rcc,
    records,
    regions,
    resets,
    scs,
    sites,
    state,
    traps,
)
from targets.mcu.decode import INFO, decode
from targets.mcu.image import Image
from targets.mcu.memory_map import ALIAS, CCM, CCM_SIZE, FLASH, SRAM, SRAM_SIZE
from targets.mcu.timing import timing

if TYPE_CHECKING:
    import unicorn

PAGE = 4096
CODE_SIZE = 0x100000
TRANSLATED_SIZE = 32 << 20
"""Room for translated code, bytes: a megabyte of flash many times over."""

TIME, TRANSMIT, FAULT, RESET = core.TIME, core.TRANSMIT, core.FAULT, core.RESET
BREAKPOINT, STEP = core.BREAKPOINT, core.STEP

MS = 1_000_000

OnFault = Literal["stop", "take"]


class Stm32f405:
    """The emulated microcontroller with `image` in flash, in reset until the first `run`.

    power_on_ns: the instant at which the supply comes up, which may lie before 0.
    on_fault: "stop" ends the run with HardFault, and with MemManage, BusFault or UsageFault unless it has a
    handler of its own; "take" runs every handler. Either ends it with lockup, a handler that is an endless
    loop or runs for longer than patience_ns, and interrupts that are disabled for as long while one waits.
    flash: uint8, the flash memory itself; what is written to it the program sees (code: see `patch`).
    """

    def __init__(
        self, image: Image, power_on_ns: int = 0, on_fault: OnFault = "stop", patience_ns: int = 1000 * MS
    ) -> None:
        self.image = image
        self._on_fault = {"stop": faults.STOP, "take": faults.TAKE}[on_fault]
        self._patience_ns = patience_ns
        self._division_hooks: list[int] = []
        self._fp_hooks: list[int] = []
        self._stepping = False
        self._watching: list[NDArray[np.int64]] = []
        self.flash = _aligned(CODE_SIZE, fill=0xFF)
        self.flash[: len(image.flash)] = np.frombuffer(image.flash, dtype=np.uint8)
        self._sram = _aligned(SRAM_SIZE)
        self._ccm = _aligned(CCM_SIZE)
        self.state = state.allocate()
        for k, (address, memory) in enumerate(((FLASH, self.flash), (SRAM, self._sram), (CCM, self._ccm))):
            self.state[state.MEMORIES + 3 * k :][:3] = (address, len(memory), memory.ctypes.data)
        self._breakpoints: list[int] = []
        self._records = records.attach(self.state)
        self._engine = _engine(self)
        for address, content in image.ram:
            self._engine.mem_write(address, content)
        self._hook_sites(traps.on_send_event, sites.send_events(image))
        self._reset(power_on_ns)

    def _reset(self, t_ns: int) -> None:
        S = self.state
        figures = timing()
        S[state.PIPELINE : state.PIPELINE + figures.pipeline.size] = figures.pipeline.ravel()
        S[state.ENTRY_CYCLES] = figures.exceptions["entry"]
        S[state.EXIT_CYCLES] = figures.exceptions["exit"]
        S[state.TAIL_CYCLES] = figures.exceptions["tail_chain"]
        S[state.BASE_NS] = t_ns
        S[state.HZ] = rcc.HSI_HZ
        rcc.reset(S)
        resets.reset_all(S)
        bxcan.reset(S)
        scs.reset(S)
        S[state.VTOR] = vectors = self.image.vectors or FLASH
        stack, entry = (self.read_word(vectors + offset) for offset in (0, 4))
        native.set_register(S, core.REG_SP, stack)
        native.set_register(S, core.REG_LR, 0xFFFFFFFF)
        S[state.PC] = S[state.NEXT] = entry & ~1
        S[state.THUMB] = entry & 1
        S[state.ON_FAULT] = self._on_fault
        S[state.PATIENCE_NS] = self._patience_ns
        S[state.MASKED_NS] = S[state.FAULTED_NS] = preemption.NEVER_NS
        S[state.FPU_WATCH] = attention.BY_BLOCK if sites.fp(self.image) else attention.UNUSED

    def run(self, until_ns: int) -> int:
        """Run until `until_ns`; TIME, or TRANSMIT earlier if a mailbox asks for the bus, or BREAKPOINT.

        A breakpoint stops before its instruction; run again from there, it lets that instruction pass.
        Raises FirmwareFault if the program did what ends a run (see on_fault), or asked for a reset.
        """
        S = self.state
        S[state.UNTIL_NS] = until_ns
        # A core asleep has not come to the instruction at its program counter.
        passes = self._breakpoints and not S[state.SLEEPING]
        S[state.BREAK_PASSED] = S[state.PC] if passes else -1
        self._stepping = False
        return self._run()

    def step(self, until_ns: int | None = None) -> int:
        """Run one instruction, of a handler if an interrupt is due: STEP; TIME if it sleeps to `until_ns`.

        until_ns: by default a second from now. An IT block counts as one instruction. Other reasons to stop
        as in `run`.
        """
        S = self.state
        S[state.UNTIL_NS] = self.now_ns + 1000 * MS if until_ns is None else until_ns
        S[state.BREAK_PASSED] = S[state.PC]
        S[state.COUNT] = 1
        if not self._stepping:
            self._engine.ctl_flush_tb()  # what has been translated does not count instructions
            self._stepping = True
        try:
            return self._run()
        finally:
            S[state.COUNT] = 0

    def _run(self) -> int:
        S = self.state
        while (reason := int(core.run(S))) in (core.MORE_HOOKS, core.DECODE):
            if reason == core.DECODE:
                self._decode()
            else:
                self._install_hooks()
        if reason == FAULT:
            raise diagnosis.fault(S, self.image)
        if reason == RESET:
            raise diagnosis.reset(S, self.image, self.registers())
        return reason

    def _decode(self) -> None:
        """Give the block that the core is about to run its rows."""
        S = self.state
        address, size = int(S[state.DECODE_AT]), int(S[state.DECODE_SIZE])
        S[state.DECODE_SIZE] = 0
        at = pipeline.row(address)
        if at == pipeline.NOWHERE:
            raise FirmwareFault(f"code runs outside flash and SRAM at {self.where()}")
        rows = decode(self.read_bytes(address, size), address)
        S[at : at + rows.size] = rows.ravel()
        found = [address + 2 * k for k, info in enumerate(rows[:, INFO].tolist()) if dynamic.is_dynamic(info)]
        if found:
            self._hook_sites(dynamic.on_instruction, found)

    @property
    def engine(self) -> "unicorn.Uc":
        """Unicorn itself, for memory beside that of the real MCU."""
        return self._engine

    def watch_blocks(self, callback: int, memory: NDArray[np.int64]) -> None:
        """Have the C function at `callback` called for each basic block, too, once its time is charged.

        memory: what it is given; it is kept as long as the machine.
        """
        import unicorn

        self._watching.append(memory)
        _hook(self._engine, unicorn.UC_HOOK_BLOCK, callback, ctypes.c_void_p(memory.ctypes.data))

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

    def set_breakpoints(self, addresses: Iterable[int]) -> None:
        """Stop before the instructions at `addresses`, and no longer at those set before."""
        sites = sorted({at & ~1 for at in addresses})
        self._breakpoints = self._hook_sites(traps.on_breakpoint, sites, self._breakpoints)

    def registers(self) -> dict[str, int]:
        """The core registers by name: r0 to r12, sp, lr, pc, xpsr, msp, psp, primask, ..., s0 to s31."""
        S = self.state
        values = {name: int(native.get_register(S, number)) for name, number in core.REGISTERS.items()}
        return values | {"pc": self.pc}

    def set_register(self, name: str, value: int) -> None:
        """Write one of `registers`; KeyError for another name."""
        S = self.state
        if name == "pc":
            S[state.PC] = value & ~1
            blocks.restart(S)
            S[state.SLEEPING] = 0
        else:
            native.set_register(S, core.REGISTERS[name], value & 0xFFFFFFFF)

    def where(self) -> str:
        """The program counter, the function it is in, and the source line."""
        return diagnosis.place(self.image, self.pc)

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

    def read_memory(self, address: int, count: int) -> bytes:
        """Bytes of memory or of devices, as a debugger reads them; FirmwareError if nothing answers there.

        Devices are read by words and half-words as the alignment lets it, with the effects a read has.
        """
        return b"".join(
            self._read(at, size).to_bytes(size, "little") for at, size in _accesses(address, count)
        )

    def write_memory(self, address: int, data: bytes) -> None:
        """Write memory, flash too, or devices as a debugger does; FirmwareError if nothing answers there."""
        if FLASH <= address < FLASH + CODE_SIZE:
            self.patch(address, data)
            return
        for at, size in _accesses(address, len(data)):
            part = data[at - address : at - address + size]
            if _is_device(at):
                peripherals.store(self.state, at, size, int.from_bytes(part, "little"))
            else:
                self._memory(self._engine.mem_write, at, part)

    def _read(self, address: int, size: int) -> int:
        if _is_device(address):
            return int(peripherals.load(self.state, address, size))
        return int.from_bytes(self._memory(self._engine.mem_read, address, size), "little")

    def _memory(self, access: Callable[[int, Any], Any], address: int, what: Any) -> Any:
        import unicorn

        try:
            return access(address, what)
        except unicorn.UcError:
            raise FirmwareError(f"no memory at {address:#010x}") from None

    def patch(self, address: int, data: bytes) -> None:
        """Write to flash as a debugger would: code that has been translated already is forgotten."""
        at = address - FLASH
        self.flash[at : at + len(data)] = np.frombuffer(data, dtype=np.uint8)
        for start in (address, address - FLASH + ALIAS):
            self._engine.ctl_remove_cache(start, start + len(data))

    def _install_hooks(self) -> None:
        """Put in place what the firmware has come to need since it was started."""
        S = self.state
        wanted = int(S[state.SET_UP])
        S[state.SET_UP] = 0
        if wanted & faults.DIVISIONS and not self._division_hooks:
            self._division_hooks = self._hook_sites(traps.on_division, sites.divisions(self.image))
        if wanted & faults.FPU_OFF:
            self._fp_hooks = self._hook_sites(traps.on_fp, sites.fp(self.image))
        elif wanted & faults.FPU_ON and self._fp_hooks and attention.has_fpu(S):
            self._fp_hooks = self._hook_sites(traps.on_fp, (), self._fp_hooks)
            S[state.FPU_WATCH] = attention.BY_BLOCK

    def _hook_sites(self, callback: Any, addresses: Iterable[int], instead: Iterable[int] = ()) -> list[int]:
        """Have `callback` called before each of these instructions, and no longer by the hooks `instead`."""
        import unicorn

        user = ctypes.c_void_p(state.as_pointer(self.state))
        for handle in instead:
            _unhook(self._engine, handle)
        hooks = [_hook(self._engine, unicorn.UC_HOOK_CODE, callback.address, user, at) for at in addresses]
        self._engine.ctl_flush_tb()  # what has been translated calls the hooks of before
        return hooks


def _is_device(address: int) -> bool:
    inside = 0 <= address - peripherals.PERIPHERALS < peripherals.PERIPHERALS_SIZE
    return inside or 0 <= address - peripherals.SYSTEM < peripherals.SYSTEM_SIZE


def _accesses(address: int, count: int) -> Iterator[tuple[int, int]]:
    """The aligned accesses of 4, 2 or 1 bytes that cover `count` bytes: (address, size)."""
    end = address + count
    while address < end:
        size = next(s for s in (4, 2, 1) if address % s == 0 and address + s <= end)
        yield address, size
        address += size


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
    read, write = (ctypes.c_void_p(f.address) for f in (regions.on_read, regions.on_write))
    for k, (base, size) in enumerate(regions.REGIONS):
        region = ctypes.c_void_p(regions.user_data(S, k))
        # Without a callback for writes a region is read-only: what lies there is in ROM.
        written = None if base == identity.BASE else write
        _checked(library.uc_mmio_map(uc._uch, base, size, read, region, written, region))
    _hook(uc, unicorn.UC_HOOK_BLOCK, blocks.on_block.address, user)
    _hook(uc, unicorn.UC_HOOK_INTR, traps.on_interrupt.address, user)
    _hook(uc, unicorn.UC_HOOK_MEM_INVALID, traps.on_invalid.address, user)
    return uc


def _hook(uc: "unicorn.Uc", kind: int, callback: int, user: ctypes.c_void_p, at: int | None = None) -> int:
    """Have `callback` called, for the instruction at `at` or for all; the hook's handle."""
    from unicorn.unicorn_py3 import unicorn as binding

    handle = ctypes.c_size_t()
    first, last = (ctypes.c_uint64(edge) for edge in ((1, 0) if at is None else (at, at)))
    _checked(
        binding.uclib.uc_hook_add(
            uc._uch, ctypes.byref(handle), kind, ctypes.c_void_p(callback), user, first, last
        )
    )
    return handle.value


def _unhook(uc: "unicorn.Uc", handle: int) -> None:
    from unicorn.unicorn_py3 import unicorn as binding

    _checked(binding.uclib.uc_hook_del(uc._uch, ctypes.c_size_t(handle)))


def _checked(error: int) -> None:
    if error:
        import unicorn

        raise RuntimeError(f"the emulator refused its set-up: {unicorn.UcError(error)}")

"""The report of a fault that ended a run: what the CPU recorded, in words, with function and source line."""

from targets.errors import FirmwareFault
from targets.mcu import faults, state
from targets.mcu.image import Image
from targets.mcu.state import State

RESETS = {
    2: ("watchdog", "the independent watchdog was not fed"),
    3: ("watchdog", "the window watchdog was fed too early, or not"),
}
"""RESET_CAUSE -> kind and words, beside the reset that the firmware itself asked for."""

_SOFTWARE_RESET = ("reset", "the firmware asked for a system reset")
_NAMES = (*(f"r{k}" for k in range(13)), "sp", "lr", "pc", "xpsr")
_STATUS = {"cfsr": state.CFSR, "hfsr": state.HFSR, "mmfar": state.MMFAR, "bfar": state.BFAR}
_STACK_NEAR = 1024
"""An access outside memory this near to the stack pointer is one to the stack."""


def place(image: Image, pc: int) -> str:
    """`pc 0x08000100 in main (main.c:12)`, as far as it is known."""
    name, line = image.function_at(pc), image.line_at(pc)
    return f"pc {pc:#010x}" + (f" in {name}" if name else "") + (f" ({line})" if line else "")


def fault(S: State, image: Image) -> FirmwareFault:
    """The fault that `core.run` stopped for."""
    registers = dict(zip(_NAMES, state.words(S, state.FAULT_REGISTERS, len(_NAMES)), strict=True))
    registers |= {name: int(S[slot]) for name, slot in _STATUS.items()}
    kind, words = _words(S, registers["sp"])
    patience = f"{int(S[state.PATIENCE_NS]) / 1e9:g} s"
    if S[state.FAULT_KIND] == faults.MASKED:
        waiting = faults.exception_name(int(S[state.FAULT_ADDRESS]))
        kind, words = "interrupts-disabled", f"interrupts disabled for {patience} while {waiting} waits"
    elif S[state.FAULT_KIND] == faults.DEAD_END:
        taken = faults.exception_name(int(S[state.FAULT_ADDRESS]))
        kind, words = "no-handler", f"{taken}, whose handler is an endless loop, was taken"
    elif S[state.ERROR] == faults.HANDLER_STUCK:
        words = f"{words}, and its handler has not returned for {patience},"
    elif S[state.FAULT_EXCEPTION] == faults.LOCKUP:
        kind, words = "lockup", f"lockup in the handler of a fault: {words}"
    return _at(image, registers, kind, words)


def reset(S: State, image: Image, registers: dict[str, int]) -> FirmwareFault:
    """The reset that was asked for, and the fault that came before it, if there was one."""
    kind, words = RESETS.get(int(S[state.RESET_CAUSE]), _SOFTWARE_RESET)
    if S[state.FAULT_COUNT]:
        at = int(S[state.FAULT_REGISTERS + _NAMES.index("pc")])
        before = _words(S, int(S[state.FAULT_REGISTERS + _NAMES.index("sp")]))[1]
        words = f"{words} after a fault ({before} at {place(image, at)}),"
    return _at(image, registers, kind, words)


def _at(image: Image, registers: dict[str, int], kind: str, words: str) -> FirmwareFault:
    pc = registers["pc"]
    return FirmwareFault(
        f"{words} at {place(image, pc)}", kind, pc, image.function_at(pc), image.line_at(pc), registers
    )


def _words(S: State, sp: int) -> tuple[str, str]:
    number, address = int(S[state.FAULT_KIND]), int(S[state.FAULT_ADDRESS])
    access = faults.ACCESS_WORDS[int(S[state.FAULT_ACCESS])]
    kind, words = faults.KINDS.get(number, ("", ""))
    if number == faults.DATA_BUS:
        near = abs(address - sp) < _STACK_NEAR
        kind, words = ("stack", "stack overflow: " + words) if near else (access, words)
    return kind, words.format(access=access, address=f"{address:#010x}")

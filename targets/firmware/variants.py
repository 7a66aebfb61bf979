"""The codes that can be built: the shipped one, and what came before it in the five-step procedure (V.5.2).

Belongs here: which sources and which flags. Never: running the compiler, what came of it.
"""

from dataclasses import dataclass

_SHELL = (
    "core/calibration.c",
    "core/checks.c",
    "core/ifd.c",
    "core/ecu.c",
    "stm32f405/startup.c",
    "stm32f405/board.c",
    "stm32f405/main.c",
)

_MACHINE = ("-mcpu=cortex-m4", "-mthumb")
_NO_FPU = ("-mfloat-abi=soft",)
_FPU = ("-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")

FINAL_FLAGS = (
    "-O3",
    # The kernels are written in the order in which the Cortex-M4 likes it; the compiler's own order mixes
    # loads from flash and SRAM, which then no longer overlap.
    "-fno-tree-ter",
    "-fno-schedule-insns",
    "-fno-schedule-insns2",
    # A 32-bit load that straddles two words may not overlap with the next one.
    "-falign-loops=4",
)

LIBRARY_FLAGS = ("-O2",)
"""Of the exponential in every step: a library comes compiled, whatever the options of the program."""


@dataclass(frozen=True)
class Variant:
    """A code of the scheme: sources, the flags they are compiled with, and the library's sources."""

    says: str
    flags: tuple[str, ...]
    sources: tuple[str, ...]
    library: tuple[str, ...] = ()
    fpu: bool = True

    @property
    def machine(self) -> tuple[str, ...]:
        """The flags that say what the code runs on."""
        return (*_MACHINE, *(_FPU if self.fpu else _NO_FPU))


def _initial(says: str, *flags: str, fpu: bool = True) -> Variant:
    return Variant(says, flags, ("steps/initial.c", *_SHELL), ("steps/exponential.c",), fpu)


FINAL = Variant(
    "loads in order: final optimised code (STEP 4)", FINAL_FLAGS, ("core/narx.c", "core/residual.c", *_SHELL)
)

STEPS = {
    "initial": _initial("initial code (STEP 2)", "-O0", fpu=False),
    "compiler": _initial("compiler-optimised code (STEP 3)", "-O1", fpu=False),
    "final": FINAL,
}
"""The codes of Table V.13. STEP 3 is the thesis's choice, level O1."""

_PRACTICES = {
    "single": ("tansig in single precision, not the library", "-DSINGLE"),
    "wide": ("32-bit counters", "-DWIDE"),
    "jammed": ("loops jammed", "-DJAMMED"),
    "unrolled": ("loops unrolled by the compiler", "-funroll-loops"),
    "down": ("loops that count down", "-DDOWN"),
}
_ADDED = [flag for _, flag in _PRACTICES.values()]

LADDER = {
    "initial": STEPS["initial"],
    "compiler": STEPS["compiler"],
    "O3": _initial("the compiler's highest level, -O3", "-O3", fpu=False),
    "fpu": _initial("the FPU", "-O3"),
    **{
        name: _initial(says, "-O3", *_ADDED[: k + 1])
        for k, (name, (says, _)) in enumerate(_PRACTICES.items())
    },
    "core": Variant("final source: delay lines, three rows at a time", ("-O3",), FINAL.sources),
    "final": FINAL,
}
"""From the initial to the final code, one practice after the other: each has what those before it have."""

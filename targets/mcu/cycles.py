"""The cycle model: what each instruction of the flash costs, cumulated over addresses.

`timing.toml` holds the figures. Belongs here: reading instructions. Never: executing them.
"""

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

TIMING = Path(__file__).with_name("timing.toml")

_MULTIPLE = frozenset({"ldm", "stm", "push", "pop", "vldm", "vstm", "vpush", "vpop"})
_ACCESS = frozenset({"ldr", "str", "vldr", "vstr"})
_FLOAT_RESULT = frozenset({"vadd", "vsub", "vmul", "vnmul", "vmla", "vmls", "vnmla", "vnmls"}) | frozenset(
    {"vfma", "vfms", "vfnma", "vfnms", "vdiv", "vsqrt", "vcvt"}
)


@dataclass(frozen=True)
class Timing:
    """The figures of `timing.toml`."""

    branch_penalty: int
    exception_entry: int
    exception_exit: int
    tail_chain: int
    cycles: dict[str, int]
    pairs: dict[str, int]


@cache
def timing() -> Timing:
    """The shipped figures."""
    with TIMING.open("rb") as file:
        return Timing(**tomllib.load(file))


def cumulated(code: bytes, origin: int, spans: list[tuple[int, int]]) -> NDArray[np.int64]:
    """Cycles of all instructions before each halfword of `code`: int64 (len(code) // 2 + 1,).

    code lies at address `origin`; spans are the address ranges [start, end) that hold instructions, the rest
    is data and costs nothing. The sum over a straight run of code is the difference of two entries.
    """
    costs = np.zeros(len(code) // 2 + 1, dtype=np.int64)
    for start, end in spans:
        previous: _Instruction | None = None
        for instruction in _disassemble(code[start - origin : end - origin], start):
            costs[(instruction.address - origin) // 2 + 1] = cost(instruction, previous)
            previous = instruction
    return np.cumsum(costs)


@dataclass(frozen=True)
class _Instruction:
    address: int
    name: str  # without condition, width and type suffixes: `vadd`, `ldr`
    registers: int  # in the list of a multiple transfer
    reads: frozenset[str]
    writes: frozenset[str]


def cost(instruction: _Instruction, previous: _Instruction | None) -> int:
    """Cycles of an instruction that follows `previous` in memory, not counting a taken branch's refill."""
    figures, pairs = timing().cycles, timing().pairs
    cycles = figures.get(instruction.name, figures["default"])
    if instruction.name in _MULTIPLE:
        return cycles + instruction.registers
    if previous is None:
        return cycles
    overlaps = instruction.name in _ACCESS and previous.name in _ACCESS
    if overlaps and not previous.writes & instruction.reads:
        return pairs["load_after_access"]
    if previous.name in _FLOAT_RESULT and previous.writes & instruction.reads:
        return cycles + pairs["float_use"]
    return cycles


def _disassemble(code: bytes, address: int) -> list[_Instruction]:
    import capstone

    engine = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
    engine.detail = True
    engine.skipdata = True
    return [_read(i) for i in engine.disasm(code, address) if i.id != 0]


def _read(instruction: Any) -> _Instruction:
    read, written = instruction.regs_access()
    names = instruction.reg_name
    registers = instruction.op_str.count(",") + 1 if instruction.id else 0
    name = _family(instruction.mnemonic)
    if name in _MULTIPLE:
        operands = len(instruction.operands)
        registers = operands - 1 if name in ("ldm", "stm", "vldm", "vstm") else operands
    return _Instruction(
        instruction.address,
        name,
        registers,
        frozenset(names(r) for r in read),
        frozenset(names(r) for r in written),
    )


@cache
def _family(mnemonic: str) -> str:
    """`vadd.f32` -> vadd, `ldrb.w` -> ldr, `addeq` -> add: the key of a figure, as far as one is needed."""
    base = mnemonic.split(".", maxsplit=1)[0]
    known = timing().cycles
    if base in known:
        return base
    for stem in sorted(known, key=len, reverse=True):
        rest = base[len(stem) :]
        if base.startswith(stem) and rest in _SUFFIXES:
            return stem
    return base


_CONDITIONS = [
    "eq",
    "ne",
    "hs",
    "lo",
    "cs",
    "cc",
    "mi",
    "pl",
    "vs",
    "vc",
    "hi",
    "ls",
    "ge",
    "lt",
    "gt",
    "le",
    "al",
]
_WIDTHS = ("", "b", "h", "sb", "sh", "ia", "db", "t", "bt", "ht", "ex", "exb", "exh")
_SUFFIXES = frozenset(width + condition for width in _WIDTHS for condition in ("", *_CONDITIONS))

"""What the cycle model needs to know of an instruction, as a row of integers.

Belongs here: reading instructions. Never: what they cost together (`pipeline`), or executing them.
"""

from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from targets.mcu.state import ROW_WORDS
from targets.mcu.timing import timing

# A row, by the instruction's first halfword. All zero: not decoded yet.
INFO, AGU, WRITES, BASE, FP_READS, FP_WRITES, ADDRESS, OPERANDS = range(8)
ROW = ROW_WORDS
"""Words in a row."""

# INFO: kind in bits 7:0, halfwords in 9:8, words transferred in 15:10, cycles in 23:16, flags above,
# condition code from 28 on
SIZE_AT, COUNT_AT, CYCLES_AT = 8, 10, 16
WRITES_PC, CONDITIONAL, ACCUMULATES, LITERAL = 1 << 24, 1 << 25, 1 << 26, 1 << 27
CONDITION_AT = 28

# Kinds
ALU, NOP, LOAD, STORE, STORE_INDEXED, LOAD_MANY, STORE_MANY = range(1, 8)
BRANCH, BRANCH_REGISTER, TABLE, FP, FP_LONG, DIVIDE, IT, BARRIER = range(8, 16)

# ADDRESS: base register in bits 3:0, index register in 7:4 with HAS_INDEX, its shift in 12:9, width in bytes
# in 19:16, offset (signed) from bit 32 on. Zero: no single access to memory.
# OPERANDS of a division: dividend in bits 3:0, divisor in 7:4, bit 8 if they are signed
HAS_INDEX, WIDTH_AT, OFFSET_AT = 1 << 8, 16, 32

_LOADS = frozenset(
    {"ldr", "ldrb", "ldrh", "ldrsb", "ldrsh", "ldrt", "ldrbt", "ldrht", "ldrsbt", "ldrsht", "vldr"}
    # "STREX is treated more like a load" (TRM 3.3.3)
    | {"ldrex", "ldrexb", "ldrexh", "strex", "strexb", "strexh"}
)
_STORES = frozenset(("str", "strb", "strh", "strt", "strbt", "strht", "vstr"))
_LOADS_MANY = frozenset(("ldm", "ldmdb", "pop", "ldrd", "vldmia", "vldmdb", "vldm", "vpop"))
_STORES_MANY = frozenset(("stm", "stmdb", "push", "strd", "vstmia", "vstmdb", "vstm", "vpush"))
_BRANCHES = frozenset(("b", "bl", "cbz", "cbnz"))
_WIDTHS = {"b": 1, "h": 2}
_CONDITIONS = ["eq", "ne", "hs", "lo", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le", "al"]
_CORE = {f"r{k}": k for k in range(13)} | {
    "sb": 9,
    "sl": 10,
    "fp": 11,
    "ip": 12,
    "sp": 13,
    "lr": 14,
    "pc": 15,
}


@lru_cache(maxsize=1 << 14)
def decode(code: bytes, address: int) -> NDArray[np.int64]:
    """Rows of the instructions in `code`, which lies at `address`: int64 (len(code) // 2, ROW).

    What is no instruction gets the row of a one-cycle halfword, so that everything decoded has one. Kept, and
    read-only: the machines of one image ask for the same blocks, and a live one has no time for it.
    """
    rows = np.zeros((len(code) // 2, ROW), dtype=np.int64)
    rows[:, INFO] = ALU | 1 << SIZE_AT | 1 << CYCLES_AT
    for instruction in _engine().disasm(code, address):
        if instruction.id:
            rows[(instruction.address - address) // 2] = _row(instruction)
    rows.setflags(write=False)
    return rows


@cache
def _engine() -> Any:
    import capstone

    engine = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
    engine.detail = True
    engine.skipdata = True
    return engine


def _registers(name: str) -> tuple[int, int]:
    """Masks of a register's name: core registers, single-precision registers."""
    if name in _CORE:
        return 1 << _CORE[name], 0
    if name[0] == "s" and name[1:].isdigit():
        return 0, 1 << int(name[1:])
    if name[0] == "d" and name[1:].isdigit() and int(name[1:]) < 16:
        return 0, 3 << 2 * int(name[1:])
    return 0, 0


def stem(mnemonic: str, condition: int) -> str:
    """The mnemonic without types, width and condition: `vaddeq.f32` is vadd."""
    name = mnemonic.split(".", maxsplit=1)[0]
    if 0 < condition < len(_CONDITIONS):
        name = name.removesuffix(_CONDITIONS[condition - 1])
    return name


def _row(instruction: Any) -> list[int]:
    from capstone import CS_AC_WRITE, arm

    name = stem(instruction.mnemonic, instruction.cc)
    agu = writes = fp_reads = fp_writes = place = 0
    names = []
    memory = None
    for operand in instruction.operands:
        if operand.type == arm.ARM_OP_REG:
            names.append(instruction.reg_name(operand.reg))
            core, single = _registers(names[-1])
            if operand.access & CS_AC_WRITE:
                writes, fp_writes = writes | core, fp_writes | single
            if operand.access != CS_AC_WRITE:
                fp_reads |= single
        elif operand.type == arm.ARM_OP_MEM:
            memory = operand.mem
            for register in (memory.base, memory.index):
                if register:
                    agu |= _registers(instruction.reg_name(register))[0]
            place = _place(instruction, operand, name)
    for register in instruction.regs_access()[1]:
        writes |= _registers(instruction.reg_name(register))[0]

    many = name in _LOADS_MANY or name in _STORES_MANY
    count = 1
    base = agu if memory and instruction.writeback else 0
    if many:
        listed = names if name in ("push", "pop", "vpush", "vpop", "ldrd", "strd") else names[1:]
        if memory is None:
            pointer = "sp" if len(listed) == len(names) else names[0]
            agu = _registers(pointer)[0]
            base = agu if instruction.writeback or pointer == "sp" else 0
        masks = [_registers(entry) for entry in listed]
        singles = sum(mask for _, mask in masks)
        count = singles.bit_count() or len(listed)
        fp_reads, fp_writes = (0, singles) if name in _LOADS_MANY else (singles, 0)
        # Earlier words are long in the register bank when the last one arrives.
        writes = masks[-1][0] if name in _LOADS_MANY else 0
    elif name in ("vldr", "vstr"):
        count = (fp_writes | fp_reads).bit_count()
        fp_reads, fp_writes = (0, fp_writes | fp_reads) if name == "vldr" else (fp_reads | fp_writes, 0)
    writes &= ~base

    kind, cycles, flags = _kind(name, memory, names, count)
    loads_pc = any(_CORE.get(entry) == 15 for entry in names) and kind in (LOAD, LOAD_MANY)
    if loads_pc or (kind == ALU and writes >> 15 & 1):
        flags |= WRITES_PC
        kind = BRANCH_REGISTER if kind == ALU else kind
    if instruction.cc not in (0, arm.ARM_CC_AL):
        flags |= CONDITIONAL | instruction.cc - 1 << CONDITION_AT
    if agu >> 15 & 1:
        flags |= LITERAL
    agu &= 0x7FFF
    info = kind | instruction.size // 2 << SIZE_AT | count << COUNT_AT | cycles << CYCLES_AT | flags
    operands = 0
    if kind == DIVIDE:
        operands = _CORE[names[-2]] | _CORE[names[-1]] << 4 | (name == "sdiv") << 8
    return [info, agu, writes & 0x7FFF, base & 0x7FFF, fp_reads, fp_writes, place, operands]


def _kind(name: str, memory: Any, names: list[str], count: int) -> tuple[int, int, int]:
    """Kind, cycles and flags of an instruction."""
    figures = timing()
    if name in _LOADS or name in _STORES:
        if count == 2:  # a double register
            return (LOAD_MANY if name in _LOADS else STORE_MANY), 1, 0
        if name in _LOADS:
            return LOAD, 1, 0
        return (STORE_INDEXED if memory and memory.index else STORE), 1, 0
    if name in _LOADS_MANY:
        return LOAD_MANY, 1, 0
    if name in _STORES_MANY:
        return STORE_MANY, 1, 0
    if name in _BRANCHES:
        return BRANCH, 1, 0
    if name in ("bx", "blx"):
        return BRANCH_REGISTER, 1, 0
    if name in ("tbb", "tbh"):
        return TABLE, 1, 0
    if name in ("nop", "yield", "sev", "wfe", "wfi"):
        return NOP, 1, 0
    if name in ("sdiv", "udiv"):
        return DIVIDE, 1, 0
    if name.startswith("it") and len(name) <= 5 and not set(name[1:]) - set("te"):
        return IT, 1, 0
    if name in ("isb", "dsb", "dmb"):
        return BARRIER, figures.cycles[name], 0
    if name in figures.fp_long:
        return FP_LONG, figures.cycles[name], 0
    if name in figures.fp_cycles:
        return FP, figures.fp_cycles[name], ACCUMULATES if name[-3:] in ("mla", "mls", "fma", "fms") else 0
    if name == "vmov" and len(names) > 2:  # two core registers at once
        return ALU, 2, 0
    return ALU, figures.cycles.get(name, 1), 0


def _place(instruction: Any, operand: Any, name: str) -> int:
    """How a single load or store computes its address, packed as ADDRESS says; 0 for anything else."""
    if name not in _LOADS and name not in _STORES:
        return 0
    memory = operand.mem
    base = _CORE.get(instruction.reg_name(memory.base), 15) if memory.base else 15
    if base == 15:
        return 0
    width = _WIDTHS.get(name.rstrip("t").removesuffix("ex")[-1:], 4) if name[0] != "v" else 4
    offset = 0 if instruction.post_index else memory.disp
    place = base | width << WIDTH_AT | offset << OFFSET_AT
    if memory.index:
        shift = operand.shift.value or memory.lshift
        place |= _CORE[instruction.reg_name(memory.index)] << 4 | HAS_INDEX | shift << 9
    return place

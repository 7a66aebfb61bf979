"""What a register is called: `registers.toml`, searched by address."""

import tomllib
from bisect import bisect_right
from functools import cache
from pathlib import Path

NAMES = Path(__file__).with_name("registers.toml")
SIZE = 0x400
"""Of a peripheral's addresses, if the table does not say."""


@cache
def _table() -> tuple[list[tuple[int, int, str, str]], dict[str, list[str]]]:
    """Peripherals (base, end, name, kind) in order, and the registers of each kind."""
    with NAMES.open("rb") as file:
        names = tomllib.load(file)
    rows = sorted(
        (base, base + (size[0] if size else SIZE), name, kind)
        for name, (base, kind, *size) in names["peripherals"].items()
    )
    return rows, names["registers"]


def name(address: int) -> str:
    """`USART2_BRR`, `BKPSRAM+0x10` where registers have no names, '' outside every peripheral."""
    rows, registers = _table()
    k = bisect_right(rows, address, key=lambda row: row[0]) - 1
    if k < 0 or address >= rows[k][1]:
        return ""
    base, _, peripheral, kind = rows[k]
    names, word = registers.get(kind, []), (address - base) // 4
    if word < len(names) and names[word]:
        return f"{peripheral}_{names[word]}"
    return f"{peripheral}+{address - base:#x}"

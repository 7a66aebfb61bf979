"""Where the cycles of a step go: by function, by source line, by instruction.

The cycle model charges basic blocks; a block's charge is split over its instructions by their own costs, and
what entering it cost besides belongs to the branch that led there. Belongs here: counting. Never: a table.
"""

from bisect import bisect_right
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

from targets.mcu import gpio, state
from targets.mcu.image import FLASH, Image
from targets.mcu.machine import Stm32f405
from targets.oscilloscope import STEP_PIN


class Profile:
    """Counts what `mcu` does while pin `pin` of port A is high, after the first `skip` times that it is.

    Slow: a call into Python for each basic block.
    """

    def __init__(self, mcu: Stm32f405, skip: int = 0, pin: int = STEP_PIN) -> None:
        import unicorn

        self._image, self._mask, self._S = mcu.image, 1 << pin, mcu.state
        self._cycles: Counter[int] = Counter()
        self._seen, self._last, self._high = int(self._S[state.CYCLES]), 0, False
        self.pulses = -skip
        mcu._engine.hook_add(unicorn.UC_HOOK_BLOCK, self._on_block)

    def _on_block(self, engine: Any, address: int, size: int, user: Any) -> None:
        S = self._S
        now = int(S[state.CYCLES])
        charged, self._seen = now - self._seen, now
        high = bool(S[state.GPIO + gpio.ODR] & self._mask)
        if high and self.pulses >= 0:
            own = self._own(address, size)
            for at, cycles in own:
                self._cycles[at] += cycles
            entering = charged - sum(cycles for _, cycles in own)
            if entering and self._high:
                self._cycles[self._last] += entering
            self._last = own[-1][0] if own else address
        elif self._high and not high:
            self.pulses += 1
        self._high = high

    def _own(self, address: int, size: int) -> list[tuple[int, int]]:
        """Instructions of a block with their own costs."""
        S, first = self._S, state.COST + ((address - FLASH) >> 1)
        costs = ((2 * k, int(S[first + k + 1] - S[first + k])) for k in range(size // 2))
        return [(address + offset, cycles) for offset, cycles in costs if cycles]

    @property
    def total(self) -> float:
        """Cycles of a pulse, on average."""
        return sum(self._cycles.values()) / max(self.pulses, 1)

    def by_function(self) -> list[tuple[str, float]]:
        """(function, cycles a pulse), the most expensive first."""
        return self._sums(self._image.function_at)

    def by_line(self) -> list[tuple[str, float]]:
        """(file:line, cycles a pulse), the most expensive first; what was inlined counts where it stands."""
        return self._sums(lambda address: line_at(self._image, address))

    def by_instruction(self) -> list[tuple[int, float]]:
        """(address, cycles a pulse), in order of address."""
        return sorted((at, cycles / max(self.pulses, 1)) for at, cycles in self._cycles.items())

    def _sums(self, name_of: Any) -> list[tuple[str, float]]:
        sums: Counter[str] = Counter()
        for address, cycles in self._cycles.items():
            sums[name_of(address) or f"{address:#010x}"] += cycles
        return [(name, cycles / max(self.pulses, 1)) for name, cycles in sums.most_common()]


def line_at(image: Image, address: int) -> str:
    """`file:line` of the instruction at `address`, '' if it is unknown."""
    starts, places = _lines(image.source)
    k = bisect_right(starts, address) - 1
    return places[k] if k >= 0 else ""


@cache
def _lines(path: str) -> tuple[list[int], list[str]]:
    """The ELF's line table: addresses from which on a place holds, '' past the end of a sequence."""
    from elftools.elf.elffile import ELFFile

    rows: dict[int, str] = {}
    with Path(path).open("rb") as file:
        dwarf = ELFFile(file).get_dwarf_info()
        for unit in dwarf.iter_CUs():
            program = dwarf.line_program_for_CU(unit)
            # before DWARF 5 files count from 1, and folder 0 is the unit's own
            one = int(program["version"] < 5)
            files = program["file_entry"]
            folders = [b""] * one + list(program["include_directory"])
            for entry in program.get_entries():
                if entry.state is None or entry.state.address < FLASH:
                    continue
                file_name = files[entry.state.file - one]
                folder, name = folders[file_name.dir_index].decode(), file_name.name.decode()
                place = name if folder in ("", ".") else f"{folder}/{name}"
                rows[entry.state.address] = "" if entry.state.end_sequence else f"{place}:{entry.state.line}"
    starts = sorted(rows)
    return starts, [rows[start] for start in starts]

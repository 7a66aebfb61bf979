"""Where the cycles of a step go: by function, by source line, by instruction.

The cycle model charges basic blocks; a block's charge is split over its instructions by when each executes,
and what entering it cost besides belongs to the branch that led there. Belongs here: counting.
"""

from collections import Counter
from typing import Any

from targets.mcu import blocks, gpio, pipeline, state
from targets.mcu.decode import INFO, SIZE_AT
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
            own = self._own()
            for at, cycles in own:
                self._cycles[at] += cycles
            entering = charged - sum(cycles for _, cycles in own)
            if entering and self._high:
                self._cycles[self._last] += entering
            self._last = own[-1][0] if own else address
        elif self._high and not high:
            self.pulses += 1
        self._high = high

    def _own(self) -> list[tuple[int, int]]:
        """Instructions of the block that was charged last, with the cycles from each to the next."""
        S = self._S
        start, end, taken = int(S[state.BLOCK]), int(S[state.BLOCK_END]), bool(S[state.BLOCK_TAKEN])
        flow = state.FLOWS + state.FLOW_WORDS * int(S[state.BLOCK_FLOW])
        entry = state.words(S, flow, 3)
        places, begins, at = [], [], start
        while at < end:
            places.append(at)
            begins.append(int(pipeline.simulate(S, 0, *entry, start, end, taken, at)))
            at += 2 * (int(S[pipeline.row(at) + INFO]) >> SIZE_AT & 3)
        begins.append(blocks.cycles_of(int(S[state.BLOCK_CYCLES]), 0))
        return [(at, behind - begin) for at, begin, behind in zip(places, begins, begins[1:], strict=False)]

    @property
    def total(self) -> float:
        """Cycles of a pulse, on average."""
        return sum(self._cycles.values()) / max(self.pulses, 1)

    def by_function(self) -> list[tuple[str, float]]:
        """(function, cycles a pulse), the most expensive first."""
        return self._sums(self._image.function_at)

    def by_line(self) -> list[tuple[str, float]]:
        """(file:line, cycles a pulse), the most expensive first; what was inlined counts where it stands."""
        return self._sums(self._image.line_at)

    def by_instruction(self) -> list[tuple[int, float]]:
        """(address, cycles a pulse), in order of address."""
        return sorted((at, cycles / max(self.pulses, 1)) for at, cycles in self._cycles.items())

    def _sums(self, name_of: Any) -> list[tuple[str, float]]:
        sums: Counter[str] = Counter()
        for address, cycles in self._cycles.items():
            sums[name_of(address) or f"{address:#010x}"] += cycles
        return [(name, cycles / max(self.pulses, 1)) for name, cycles in sums.most_common()]

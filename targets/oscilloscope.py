"""What is measured from outside a running firmware: pulses on a pin (section V.5.2, Table V.13), and calls.

Belongs here: times in CPU cycles. Never: what runs meanwhile.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from targets.mcu import blocks, instants, state
from targets.mcu.machine import Stm32f405

STEP_PIN = 0
"""Of port A: high while the firmware computes a step."""

_BSRR = 0x40020018


class Oscilloscope:
    """A probe on pin `pin` of port A of `mcu`, from now on."""

    def __init__(self, mcu: Stm32f405, pin: int = STEP_PIN) -> None:
        import unicorn

        self._mask, self._edges = 1 << pin, list[tuple[int, int, int, int]]()
        S = mcu.state

        def on_write(engine: Any, access: int, address: int, size: int, value: int, user: Any) -> None:
            if value & (self._mask | self._mask << 16):
                site = S[state.SITE]
                instants.locate(S, address)
                counts = (state.CYCLES, state.CYCLES_MIN, state.CYCLES_MAX)
                a, b, c = (int(S[slot] - S[state.LATE + k]) for k, slot in enumerate(counts))
                self._edges.append((a, b, c, int(value & self._mask != 0)))
                instants.leave(S)
                S[state.SITE] = site

        mcu._engine.hook_add(unicorn.UC_HOOK_MEM_WRITE, on_write, begin=_BSRR, end=_BSRR + 3)

    def pulses(self) -> NDArray[np.int64]:
        """Widths of the pulses so far, in CPU cycles: (pulses, 3), by the model, at best and at worst.

        Best and worst are those of the timing figures' bounds.
        """
        edges = np.array(self._edges, dtype=np.int64).reshape(-1, 4)
        falling = np.flatnonzero((edges[1:, 3] == 0) & (edges[:-1, 3] == 1)) + 1
        widths: NDArray[np.int64] = edges[falling, :3] - edges[falling - 1, :3]
        return widths


class Stopwatch:
    """Times the calls of `function` on `mcu`, from its first instruction to its return, from now on.

    For a function called from one place. Raises FirmwareError if the image has none of that name.
    """

    def __init__(self, mcu: Stm32f405, function: str) -> None:
        import unicorn

        self._S, self._engine = mcu.state, mcu._engine
        self._entered = 0
        self._calls: list[int] = []
        entry = mcu.image.symbol(function)
        self._hook = unicorn.UC_HOOK_BLOCK
        self._return = 0
        self._engine.hook_add(self._hook, self._on_entry, begin=entry, end=entry)

    def calls(self) -> NDArray[np.int64]:
        """CPU cycles of each call that has returned, (calls,)."""
        return np.array(self._calls, dtype=np.int64)

    def _on_entry(self, engine: Any, address: int, size: int, user: Any) -> None:
        from unicorn import arm_const

        self._entered = self._before()
        if not self._return:
            self._return = engine.reg_read(arm_const.UC_ARM_REG_LR) & ~1
            engine.hook_add(self._hook, self._on_return, begin=self._return, end=self._return)

    def _on_return(self, engine: Any, address: int, size: int, user: Any) -> None:
        if self._entered:
            self._calls.append(self._before() - self._entered)
            self._entered = 0

    def _before(self) -> int:
        """Cycles when the block was entered: it has been charged already."""
        return int(self._S[state.CYCLES] - blocks.cycles_of(int(self._S[state.BLOCK_CYCLES]), 0))

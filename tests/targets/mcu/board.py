"""The MCU's devices without its core: registers by address, time passing by hand."""

from targets.mcu import bxcan, events, lines, rcc, records, resets, scs
from targets.mcu.peripherals import load, store
from targets.mcu.state import (
    CYCLES,
    CYCLES_MAX,
    CYCLES_MIN,
    HZ,
    RCC_ENABLE,
    RESET_CAUSE,
    RESET_REQUEST,
    UNMODELLED,
    allocate,
)


class Board:
    """Devices after reset, at `hz`, all with their clocks on unless `clocks` is false."""

    def __init__(self, hz: int = 16_000_000, clocks: bool = True) -> None:
        self.state = allocate()
        self._records = records.attach(self.state)
        self.state[HZ] = hz
        rcc.reset(self.state)
        scs.reset(self.state)
        bxcan.reset(self.state)
        resets.reset_all(self.state)
        if clocks:
            self.state[RCC_ENABLE : RCC_ENABLE + 6] = 0xFFFFFFFF

    def read(self, address: int, size: int = 4) -> int:
        return int(load(self.state, address, size))

    def write(self, address: int, value: int, size: int = 4) -> None:
        store(self.state, address, size, value)

    def __getitem__(self, address: int) -> int:
        return self.read(address)

    def __setitem__(self, address: int, value: int) -> None:
        self.write(address, value)

    @property
    def now(self) -> int:
        return int(self.state[CYCLES])

    def skip(self, cycles: int) -> None:
        """Time passes while the core computes: nothing is looked at."""
        for count in (CYCLES, CYCLES_MIN, CYCLES_MAX):
            self.state[count] += cycles

    def sleep(self, cycles: int) -> int:
        """Time passes as in the run loop of a sleeping core, from event to event; how many there were."""
        end, count = self.now + cycles, 0
        while True:
            events.service(self.state)
            if self.now >= end or self.reset_cause:
                return count
            at = min(int(events.due(self.state)), end)
            assert at > self.now, "an event that lies in the past would stop the core for ever"
            count += at < end
            self.skip(at - self.now)

    def lines(self) -> set[int]:
        """Interrupts whose line is up."""
        return {irq for irq in range(82) if lines.level(self.state, irq)}

    @property
    def unmodelled(self) -> set[int]:
        """Addresses of accesses that nothing answers."""
        count = int(self.state[UNMODELLED])
        return {int(address) for address in self.state[UNMODELLED + 1 : UNMODELLED + 1 + 2 * count : 2]}

    @property
    def reset_cause(self) -> int:
        """Who asked for a reset, 0 if nobody did."""
        return int(self.state[RESET_CAUSE]) if self.state[RESET_REQUEST] else 0

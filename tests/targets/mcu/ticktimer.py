"""A general-purpose timer as RM0090 section 18 describes it, one clock after the other.

Slow and plain: what the emulator's timer, which does not count, is compared with.
"""

from dataclasses import dataclass, field


@dataclass
class TickTimer:
    """Counter with prescaler, auto-reload and four compare channels; `clock` is one clock of the timer."""

    limit: int
    cr1: int = 0
    psc: int = 0
    arr: int = 0
    ccr: list[int] = field(default_factory=lambda: [0] * 4)
    modes: list[int] = field(default_factory=lambda: [0] * 4)  # OCxM
    preload: list[bool] = field(default_factory=lambda: [False] * 4)  # OCxPE
    cnt: int = 0
    down: int = 0
    sr: int = 0
    ref: list[int] = field(default_factory=lambda: [0] * 4)
    prescaler: int = 0
    started: bool = False
    psc_now: int = 0
    arr_now: int = 0
    ccr_now: list[int] = field(default_factory=lambda: [0] * 4)

    @property
    def centre(self) -> int:
        return self.cr1 >> 5 & 3

    def latch(self) -> None:
        """Registers without preload act at once."""
        if not self.cr1 & 0x80:
            self.arr_now = self.arr
        for k in range(4):
            if not self.preload[k]:
                self.ccr_now[k] = self.ccr[k]
        if not self.centre:
            self.down = self.cr1 >> 4 & 1
        self.levels()

    def levels(self) -> None:
        for k, mode in enumerate(self.modes):
            if mode in (4, 5):
                self.ref[k] = int(mode == 5)
            if mode in (6, 7):
                active = self.cnt <= self.ccr_now[k] if self.down else self.cnt < self.ccr_now[k]
                self.ref[k] = int(active) ^ (mode == 7)

    def update(self) -> None:
        if self.cr1 & 2:
            return
        self.psc_now, self.arr_now, self.ccr_now = self.psc, self.arr, list(self.ccr)
        self.sr |= 1
        if self.cr1 & 8:
            self.cr1 &= ~1

    def clock(self) -> None:
        if not self.cr1 & 1:
            return
        if not self.started:  # CNT_EN is set one clock after CEN
            self.started = True
            return
        if self.prescaler < self.psc_now:
            self.prescaler += 1
            return
        self.prescaler = 0
        if self.arr_now == 0:
            return
        self.count()

    def count(self) -> None:
        rising, top, turned = not self.down, False, False
        if self.down:
            if self.cnt <= (1 if self.centre else 0):
                turned = True
                self.update()
                self.cnt = 0 if self.centre else self.arr_now
                self.down = 0 if self.centre else 1
                top = not self.centre
            else:
                self.cnt -= 1
        elif self.cnt > self.arr_now:
            self.cnt = 0 if self.cnt == self.limit else self.cnt + 1
        elif self.centre and self.cnt + 1 >= self.arr_now:  # one put on ARR by a write turns, too
            turned = top = True
            self.update()
            self.cnt, self.down = self.arr_now, 1
        elif not self.centre and self.cnt == self.arr_now:
            turned = True
            self.update()
            self.cnt = 0
        else:
            self.cnt += 1
        for k in range(4):
            if self.cnt == self.ccr_now[k]:
                self.match(k, rising)
            elif turned and self.ccr_now[k] > self.arr_now and (top or not self.centre):
                self.sr |= 2 << k
        self.levels()

    def match(self, k: int, rising: bool) -> None:
        if not self.centre or self.centre & (2 if rising else 1):
            self.sr |= 2 << k
        if self.modes[k] in (1, 2):
            self.ref[k] = int(self.modes[k] == 1)
        if self.modes[k] == 3:
            self.ref[k] ^= 1

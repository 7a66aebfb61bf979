"""General-purpose timers TIM2 to TIM5 (RM0090 section 18): counter, update event, registers.

Nothing happens tick by tick: the counter is known at one cycle, and `settle` walks from turn to turn of it up
to the present. Not modelled: slave modes and external clocks, DMA, the XOR of channels 1 to 3.
"""

from targets.jit import njit
from targets.mcu import capture_compare, gating, gpio, rcc
from targets.mcu.capture_compare import (
    ARR,
    ARR_NOW,
    BASE,
    CCER,
    CCMR1,
    CCR,
    CCR_NOW,
    CNT,
    CR1,
    CR2,
    DIER,
    DOWN,
    EGR,
    EVENTS,
    OR,
    PHASE,
    PSC,
    PSC_NOW,
    SMCR,
    SR,
    is_output,
    slot,
)
from targets.mcu.clock import now_cycles
from targets.mcu.state import ATTEND, TIM_OUTPUT, TIM_STRIDE, State

ORIGIN = 0x40000000
TIMERS = 4
CEN, UDIS, URS, OPM, DIR, ARPE = 1, 2, 4, 8, 0x10, 0x80
CENTRE = 0x60
UIF, INTERRUPTS = 1, 0x5F
IRQS = (28, 29, 30, 50)


@njit(cache=True)
def _limit(timer: int) -> int:
    """The largest count: TIM2 and TIM5 have 32 bits, TIM3 and TIM4 sixteen."""
    return 0xFFFFFFFF if timer in (0, 3) else 0xFFFF


@njit(cache=True)
def reset(S: State, timer: int) -> None:
    """Reset values of section 18.4."""
    at = slot(timer)
    S[at : at + TIM_STRIDE] = 0
    S[at + ARR] = S[at + ARR_NOW] = _limit(timer)
    for channel in range(4):
        capture_compare.drive(S, at, channel, now_cycles(S))


@njit(cache=True)
def _is_running(S: State, timer: int) -> bool:
    return S[slot(timer) + CR1] & CEN == 1 and gating.is_on(S, gating.APB1, timer)


@njit(cache=True)
def _tick(S: State, at: int) -> int:
    """CPU cycles in a count."""
    return rcc.timer_divisor(S) * (S[at + PSC_NOW] + 1)


@njit(cache=True)
def _is_past(S: State, at: int) -> bool:
    """Counting up from above ARR: the counter runs to its largest value and no event comes of it."""
    return S[at + DOWN] == 0 and S[at + CNT] > S[at + ARR_NOW]


@njit(cache=True)
def _counts_to_turn(S: State, timer: int) -> int:
    """Counts until the counter starts again or turns round."""
    at = slot(timer)
    count, reload = S[at + CNT], S[at + ARR_NOW]
    if _is_past(S, at):
        return _limit(timer) + 1 - count
    if S[at + CR1] & CENTRE:
        return max(1, count if S[at + DOWN] else reload - count)
    return count + 1 if S[at + DOWN] else reload + 1 - count


@njit(cache=True)
def _counts_to_match(S: State, at: int, channel: int) -> int:
    """Counts until the channel's value if the counter does not turn before; not positive if it is behind."""
    ahead = S[at + CCR_NOW + channel] - S[at + CNT]
    return -ahead if S[at + DOWN] else ahead


@njit("void(int64[::1], int64, boolean)", cache=True)
def _update(S: State, at: int, forced: bool) -> None:
    """Update event (section 18.3.2): shadows are loaded, the flag set; `forced`: by UG."""
    if S[at + CR1] & UDIS:
        return
    S[at + PSC_NOW], S[at + ARR_NOW] = S[at + PSC], S[at + ARR]
    for channel in range(4):
        capture_compare.load(S, at, channel, True)
    if not (forced and S[at + CR1] & URS):
        S[at + SR] |= UIF
    if S[at + CR1] & OPM and not forced:
        S[at + CR1] &= ~CEN
        S[at + PHASE] = 0


@njit(cache=True)
def _turn(S: State, timer: int) -> None:
    """The counter starts again or turns round, at cycle BASE."""
    at = slot(timer)
    past, down = _is_past(S, at), S[at + DOWN]
    if not past:
        _update(S, at, False)
        if S[at + CR1] & CENTRE:
            S[at + DOWN] = 1 - down
    top = not past and S[at + DOWN] == 1
    S[at + CNT] = S[at + ARR_NOW] if top else 0
    for channel in range(4):
        if not is_output(S, at, channel):
            continue
        value = S[at + CCR_NOW + channel]
        if value == S[at + CNT]:
            capture_compare.match(S, at, channel, not down)
        elif value > S[at + ARR_NOW] and not past and (top or not S[at + CR1] & CENTRE):
            S[at + SR] |= 2 << channel  # out of reach: the flag comes with the turn (section 18.4.5)
        capture_compare.compare(S, at, channel, S[at + BASE])


@njit(cache=True)
def _match_below(S: State, timer: int, counts: int) -> None:
    """The next `counts` counts lead to no turn: what they match on the way."""
    at = slot(timer)
    start, base, tick = S[at + CNT], S[at + BASE], _tick(S, slot(timer))
    for channel in range(4):
        ahead = _counts_to_match(S, at, channel)
        if is_output(S, at, channel) and 1 <= ahead <= counts:
            S[at + CNT] = S[at + CCR_NOW + channel]
            capture_compare.match(S, at, channel, S[at + DOWN] == 0)
            capture_compare.compare(S, at, channel, base + ahead * tick)
            S[at + CNT] = start


@njit(cache=True)
def _is_watched(S: State, timer: int) -> bool:
    """A pin follows one of the channels: each of its edges has a time."""
    for channel in range(4):  # noqa: SIM110  # compiled code has no generators
        if S[TIM_OUTPUT + 4 * timer + channel] >= 0:
            return True
    return False


@njit(cache=True)
def _skip(S: State, timer: int, now: int) -> None:
    """Whole periods of a counter that repeats itself; an even number, because of toggling outputs."""
    at = slot(timer)
    period = 2 * S[at + ARR_NOW] if S[at + CR1] & CENTRE else S[at + ARR_NOW] + 1
    pair = 2 * period * _tick(S, at)
    S[at + BASE] += (now - S[at + BASE]) // pair * pair


@njit(cache=True)
def settle(S: State, timer: int) -> None:
    """Count to the present."""
    at, now, turns = slot(timer), now_cycles(S), 0
    while _is_running(S, timer):
        tick = _tick(S, at)
        counts = (now - S[at + BASE]) // tick
        if counts <= 0:
            return
        if S[at + ARR_NOW] == 0:  # section 18.4.12: the counter is blocked
            S[at + BASE] += counts * tick
            return
        to_turn = _counts_to_turn(S, timer)
        _match_below(S, timer, min(counts, to_turn - 1))
        if counts < to_turn:
            S[at + BASE] += counts * tick
            S[at + CNT] += -counts if S[at + DOWN] else counts
            return
        S[at + BASE] += to_turn * tick
        _turn(S, timer)
        turns += 1
        # Four turns are two periods of a centre-aligned counter: all shadows are loaded, all flags set.
        if turns == 4 and not _is_watched(S, timer):
            _skip(S, timer, now)


@njit(cache=True)
def _due(S: State, timer: int) -> int:
    at, asked = slot(timer), S[slot(timer) + DIER] & ~S[slot(timer) + SR] & 0x1F
    if S[at + CR1] & UDIS:
        asked &= ~UIF
    for channel in range(4):
        if not is_output(S, at, channel):
            asked &= ~(2 << channel)
    if asked == 0 or S[at + ARR_NOW] == 0 or not _is_running(S, timer):
        return rcc.NEVER
    counts = _counts_to_turn(S, timer)
    for channel in range(4):
        ahead = _counts_to_match(S, at, channel)
        if asked >> (channel + 1) & 1 and 1 <= ahead < counts:
            counts = ahead
    return S[at + BASE] + counts * _tick(S, at)


@njit(cache=True)
def due(S: State) -> int:
    """CPU cycles at which a flag may rise that an interrupt is enabled for; pins are looked at afterwards."""
    at = rcc.NEVER
    for timer in range(TIMERS):
        if S[slot(timer) + DIER] != 0:
            at = min(at, _due(S, timer))
    return at


@njit(cache=True)
def service(S: State) -> None:
    """Count to the present."""
    for timer in range(TIMERS):
        if S[slot(timer) + CR1] & CEN:
            settle(S, timer)


@njit(cache=True)
def _pause(S: State, timer: int) -> None:
    settle(S, timer)
    if _is_running(S, timer):
        S[slot(timer) + PHASE] = (now_cycles(S) - S[slot(timer) + BASE]) // rcc.timer_divisor(S)


@njit(cache=True)
def _resume(S: State, timer: int) -> None:
    S[slot(timer) + BASE] = now_cycles(S) - S[slot(timer) + PHASE] * rcc.timer_divisor(S)


@njit(cache=True)
def pause(S: State) -> None:
    """The timers' clock is about to change: count, and note how far the prescalers are."""
    for timer in range(TIMERS):
        _pause(S, timer)


@njit(cache=True)
def resume(S: State) -> None:
    """The timers' clock has changed: they go on at its pace."""
    for timer in range(TIMERS):
        _resume(S, timer)


@njit(cache=True)
def edge(S: State, port: int, rising: int, falling: int) -> None:
    """Pins have been changed from outside: channels that look at them capture."""
    for pin in range(16):
        channel = gpio.channel_of(S, port, pin) if (rising | falling) >> pin & 1 else -1
        if channel >= 0:
            settle(S, channel // 4)
            capture_compare.edge(S, slot(channel // 4), channel % 4, rising >> pin & 1 == 1)
            S[ATTEND] = 1


@njit(cache=True)
def line(S: State, irq: int) -> bool:
    """Level of an interrupt line."""
    at = slot(3 if irq == IRQS[3] else irq - IRQS[0])
    return S[at + SR] & S[at + DIER] & INTERRUPTS != 0


@njit(cache=True)
def peek(S: State, offset: int) -> int:
    """Value of the register at `offset` from TIM2's first, -1 if it is not modelled; nothing comes of it."""
    timer, register = offset // 0x400, (offset % 0x400) // 4
    at = slot(timer)
    settle(S, timer)
    if register == CR1:
        return S[at + CR1] & ~DIR | S[at + DOWN] << 4
    if register <= ARR or CCR <= register < CCR + 4 or (register == OR and timer in (0, 3)):
        return S[at + register]
    return -1


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Read a register: `peek`, and a capture that is read is no longer flagged (section 18.4.5)."""
    at, channel = slot(offset // 0x400), (offset % 0x400) // 4 - CCR
    value = peek(S, offset)
    if 0 <= channel < 4 and not is_output(S, at, channel):
        S[at + SR] &= ~(2 << channel)
    return value


@njit(cache=True)
def _control(S: State, timer: int, value: int) -> None:
    at, begins = slot(timer), value & ~S[slot(timer) + CR1] & CEN
    _pause(S, timer)
    S[at + CR1] = value & 0x3FF
    if value & CENTRE == 0:  # else DIR is the hardware's
        S[at + DOWN] = value >> 4 & 1
    if value & ARPE == 0:
        S[at + ARR_NOW] = S[at + ARR]
    S[at + PHASE] -= begins  # section 18.3.2: counting starts a clock after CEN
    _resume(S, timer)


@njit(cache=True)
def _generate(S: State, at: int, value: int) -> None:
    """EGR written: update and capture/compare events of software."""
    if value & 1:
        _update(S, at, True)
        S[at + CNT] = S[at + ARR_NOW] if S[at + CR1] & (CENTRE | DIR) == DIR else 0
        if S[at + CR1] & CENTRE:
            S[at + DOWN] = 0
        S[at + BASE], S[at + PHASE] = now_cycles(S), 0
    for channel in range(4):
        if value >> (channel + 1) & 1:
            if is_output(S, at, channel):
                S[at + SR] |= 2 << channel
            else:
                capture_compare.capture(S, at, channel)


@njit(cache=True)
def _store(S: State, timer: int, register: int, value: int) -> bool:
    """Write a register; False for what is not modelled of it."""
    at = slot(timer)
    if register == CR1:
        _control(S, timer, value)
    elif register == CR2:
        S[at + CR2] = value & 0xF8
        return value & 0x88 == 0  # TI1S, CCDS
    elif register == SMCR:
        S[at + SMCR] = value & 0xFFF7
        return value & 0xFF77 == 0
    elif register == DIER:
        S[at + DIER] = value & 0x5F5F
        return value & 0x5F00 == 0  # DMA
    elif register == SR:
        S[at + SR] &= value
    elif register == EGR:
        _generate(S, at, value)
        return value & 0x40 == 0
    elif register in (CCMR1, CCMR1 + 1):
        S[at + register] = value & 0xFFFF
        known = True
        for channel in (2 * (register - CCMR1), 2 * (register - CCMR1) + 1):
            capture_compare.load(S, at, channel, False)
            byte = value >> (8 * (channel % 2))
            if byte & 3 == 3 or byte & 0x83 == 0x80:  # TRC; OCxCE
                known = False
        return known
    elif register == CCER:
        S[at + CCER] = value & 0xBBBB
        for channel in range(4):
            if not value >> (4 * channel) & 1:  # section 18.4.7: the capture prescaler starts again
                S[at + EVENTS + channel] = 0
    elif register == CNT:
        S[at + CNT] = value & _limit(timer)
    elif register == PSC:
        S[at + PSC] = value & 0xFFFF
    elif register == ARR:
        S[at + ARR] = value & _limit(timer)
        if not S[at + CR1] & ARPE:
            S[at + ARR_NOW] = S[at + ARR]
    elif CCR <= register < CCR + 4:
        if is_output(S, at, register - CCR):
            S[at + register] = value & _limit(timer)
            capture_compare.load(S, at, register - CCR, False)
    else:
        return register == OR and timer in (0, 3) and value == 0
    return True


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the register at `offset` from TIM2's first; False if it is not modelled."""
    timer = offset // 0x400
    settle(S, timer)
    S[ATTEND] = 1
    known = _store(S, timer, (offset % 0x400) // 4, value)
    for channel in range(4):
        if is_output(S, slot(timer), channel):
            capture_compare.compare(S, slot(timer), channel, now_cycles(S))
        else:
            capture_compare.drive(S, slot(timer), channel, now_cycles(S))
    return known

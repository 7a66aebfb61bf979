"""Capture/compare channels of TIM2 to TIM5 (RM0090 sections 18.3.4 to 18.3.10), driven by the counter.

Also where a timer's registers lie in the state. Not modelled: the input filter, clearing OCxREF by ETR, TRC.
"""

from targets.jit import njit
from targets.mcu import gpio
from targets.mcu.state import TIM, TIM_STRIDE, State

# A timer's registers lie at their offset / 4 from its slot
CR1, CR2, SMCR, DIER, SR, EGR, CCMR1 = range(7)
CCER, CNT, PSC, ARR = range(8, 12)
CCR = 13
OR = 20
# and what they have come to: CNT is of cycle BASE, PSC_NOW, ARR_NOW and CCR_NOW are the shadow registers
BASE, PSC_NOW, ARR_NOW, CCR_NOW = 24, 25, 26, 27
DOWN, REFERENCE, PHASE, EVENTS = 31, 32, 33, 34  # EVENTS: four, edges seen by each capture prescaler

ACTIVE_ON_MATCH, INACTIVE_ON_MATCH, TOGGLE, FORCED_INACTIVE, FORCED_ACTIVE, PWM1, PWM2 = range(1, 8)


@njit(cache=True)
def slot(timer: int) -> int:
    """Where the registers of TIM2 (0) to TIM5 (3) lie."""
    return TIM + TIM_STRIDE * timer


@njit(cache=True)
def mode(S: State, at: int, channel: int) -> int:
    """The channel's byte of CCMR1 or CCMR2."""
    return S[at + CCMR1 + channel // 2] >> (8 * (channel % 2)) & 0xFF


@njit(cache=True)
def is_output(S: State, at: int, channel: int) -> bool:
    """Compares (CCxS = 0), does not capture."""
    return mode(S, at, channel) & 3 == 0


@njit("void(int64[::1], int64, int64, boolean)", cache=True)
def load(S: State, at: int, channel: int, update: bool) -> None:
    """The compare register into its shadow: at an update event, or at once without preload (OCxPE)."""
    if is_output(S, at, channel) and (update or not mode(S, at, channel) >> 3 & 1):
        S[at + CCR_NOW + channel] = S[at + CCR + channel]


@njit(cache=True)
def _refer(S: State, at: int, channel: int, active: bool) -> None:
    bit = 1 << channel
    S[at + REFERENCE] = S[at + REFERENCE] & ~bit | (bit if active else 0)


@njit(cache=True)
def drive(S: State, at: int, channel: int, cycles: int) -> None:
    """OCxREF with its polarity (CCxP) to the pins, if the channel is an output and on (CCxE)."""
    enable, level = S[at + CCER] >> (4 * channel), S[at + REFERENCE] >> channel & 1
    on = enable & 1 and is_output(S, at, channel)
    timer = (at - TIM) // TIM_STRIDE
    gpio.set_channel(S, 4 * timer + channel, level ^ enable >> 1 & 1 if on else -1, cycles)


@njit(cache=True)
def compare(S: State, at: int, channel: int, cycles: int) -> None:
    """OCxREF of the modes that compare at all times (PWM) or not at all (forced), and the pins."""
    kind = mode(S, at, channel) >> 4 & 7
    if kind >= PWM1:
        count, value = S[at + CNT], S[at + CCR_NOW + channel]
        active = count <= value if S[at + DOWN] else count < value
        _refer(S, at, channel, active == (kind == PWM1))
    elif kind >= FORCED_INACTIVE:
        _refer(S, at, channel, kind == FORCED_ACTIVE)
    drive(S, at, channel, cycles)


@njit(cache=True)
def match(S: State, at: int, channel: int, rising: bool) -> None:
    """The counter has come to the channel's value; `rising`: from below. In centre-aligned mode CMS decides
    whether that sets the flag (section 18.4.1).
    """
    centre = S[at + CR1] >> 5 & 3
    if centre == 0 or centre & (2 if rising else 1):
        S[at + SR] |= 2 << channel
    kind = mode(S, at, channel) >> 4 & 7
    if kind in (ACTIVE_ON_MATCH, INACTIVE_ON_MATCH):
        _refer(S, at, channel, kind == ACTIVE_ON_MATCH)
    elif kind == TOGGLE:
        S[at + REFERENCE] ^= 1 << channel


@njit(cache=True)
def capture(S: State, at: int, channel: int) -> None:
    """The counter into the capture register; a second time before it was read is an overcapture."""
    if S[at + SR] & 2 << channel:
        S[at + SR] |= 0x200 << channel
    S[at + CCR + channel] = S[at + CNT]
    S[at + SR] |= 2 << channel


@njit(cache=True)
def edge(S: State, at: int, pin_of: int, rising: bool) -> None:
    """The pin of channel `pin_of` has changed: channels that look at it capture, each by its polarity."""
    for channel in range(4):
        selection = mode(S, at, channel) & 3
        # CCxS: 1 the channel's own pin, 2 its neighbour's
        looks = selection in (1, 2) and pin_of == (channel if selection == 1 else channel ^ 1)
        enable = S[at + CCER] >> (4 * channel)
        # CCxNP, CCxP: 00 rising, 01 falling, 11 both
        wanted = enable & 0xA == 0xA or rising == (enable & 2 == 0)
        if not (looks and enable & 1 and wanted):
            continue
        S[at + EVENTS + channel] += 1
        if S[at + EVENTS + channel] >= 1 << (mode(S, at, channel) >> 2 & 3):  # ICxPSC
            S[at + EVENTS + channel] = 0
            capture(S, at, channel)

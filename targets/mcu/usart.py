"""USART1 to 3, UART4 and 5, USART6 (RM0090 section 30), asynchronous: what is sent is logged with its time.

A frame takes the time its baud rate gives it; the lines themselves have no edges. Not modelled: DMA, flow
control, half duplex, LIN, smartcard, IrDA, mute mode, break, synchronous clock.
"""

from targets.jit import njit
from targets.mcu import rcc, records
from targets.mcu.clock import now_cycles, ns_of
from targets.mcu.state import ATTEND, USART, USART_STRIDE, State

NAMES = ("USART1", "USART2", "USART3", "UART4", "UART5", "USART6")
_ADDRESSES = (0x40011000, 0x40004400, 0x40004800, 0x40004C00, 0x40005000, 0x40011400)
_IRQS = (37, 38, 39, 52, 53, 71)

# Registers at their offset / 4
SR, DR, BRR, CR1, CR2, CR3, GTPR = range(7)
SEEN = 8  # flags that a read of SR has shown: the next access to DR clears some of them
NEXT = 9  # the transmit data register, EMPTY if there is nothing in it
SHIFTING = 10  # what is on the line, EMPTY if nothing is
SHIFT_END = 11  # cycles
ARRIVING = 12  # cycles at which the byte on its way in is complete, NEVER if none is
IDLE_AT = 13  # cycles at which the line will have been idle for a frame
LOST = 14  # bytes that came while nobody listened, or on top of one not read

EMPTY, PREAMBLE = -1, -2
ORE, IDLE, RXNE, TC, TXE = 8, 0x10, 0x20, 0x40, 0x80
_ERRORS = 0x1F  # PE, FE, NF, ORE, IDLE: cleared by a read of SR, then of DR
UE, PCE, PS, TE, RE = 1 << 13, 1 << 10, 1 << 9, 8, 4
_UNMODELLED = ((CR1, 0x0003), (CR2, 0x4F60), (CR3, 0x07FE))
"""SBK, RWU; LINEN, CLKEN and its form, LBDIE; all of CR3 but EIE and ONEBIT."""


@njit(cache=True)
def index(address: int) -> int:
    """Which of NAMES answers at an address, -1 for none."""
    for k in range(6):
        if address & ~0x3FF == _ADDRESSES[k]:
            return k
    return -1


@njit(cache=True)
def index_of_irq(irq: int) -> int:
    """Which of NAMES has an interrupt, -1 for none."""
    for k in range(6):
        if irq == _IRQS[k]:
            return k
    return -1


@njit("void(int64[::1], int64)", cache=True)
def reset(S: State, unit: int) -> None:
    """Reset values of section 30.6."""
    at = USART + USART_STRIDE * unit
    S[at : at + LOST] = 0
    S[at + SR] = TXE | TC
    S[at + NEXT] = S[at + SHIFTING] = EMPTY
    S[at + ARRIVING] = S[at + IDLE_AT] = rcc.NEVER


@njit("boolean(int64[::1], int64, int64)", cache=True)
def _is_on(S: State, at: int, direction: int) -> bool:
    """Enabled in a direction, TE or RE, and with a baud rate."""
    return S[at + CR1] & (UE | direction) == UE | direction and S[at + BRR] >= 16


@njit(cache=True)
def frame_cycles(S: State, unit: int) -> int:
    """CPU cycles of a frame: start bit, 8 or 9 bits (M), stop bits."""
    at = USART + USART_STRIDE * unit
    divider = S[at + BRR]
    if S[at + CR1] >> 15 & 1:  # OVER8: section 30.3.4, three bits of fraction
        divider = (divider >> 4) * 8 + (divider & 7)
    halves = 2 * (9 + (S[at + CR1] >> 12 & 1)) + (2, 1, 4, 3)[S[at + CR2] >> 12 & 3]
    bus = rcc.apb2_divisor(S) if unit in (0, 5) else rcc.apb1_divisor(S)
    return divider * bus * halves // 2


@njit(cache=True)
def _data_mask(S: State, at: int) -> int:
    """The bits of a frame that carry data: with parity (PCE) one less."""
    return (1 << (8 + (S[at + CR1] >> 12 & 1) - (S[at + CR1] >> 10 & 1))) - 1


@njit(cache=True)
def _with_parity(S: State, at: int, value: int) -> int:
    """The frame of a value: the parity bit, if there is one, above the data."""
    mask = _data_mask(S, at)
    value &= mask
    if S[at + CR1] & PCE:
        ones = 1 if S[at + CR1] & PS else 0
        for bit in range(9):
            ones += value >> bit & 1
        value |= (ones & 1) * (mask + 1)
    return value


@njit("void(int64[::1], int64, int64, int64)", cache=True)
def _shift(S: State, unit: int, value: int, cycles: int) -> None:
    at = USART + USART_STRIDE * unit
    S[at + SHIFTING] = value
    S[at + SHIFT_END] = cycles + frame_cycles(S, unit)


@njit(cache=True)
def _settle_transmitter(S: State, unit: int, now: int) -> None:
    at = USART + USART_STRIDE * unit
    while S[at + SHIFTING] != EMPTY and S[at + SHIFT_END] <= now:
        end = S[at + SHIFT_END]
        if S[at + SHIFTING] >= 0:
            records.append(S, records.LOG + unit, (ns_of(S, end), S[at + SHIFTING]))
        if S[at + NEXT] != EMPTY:
            _shift(S, unit, S[at + NEXT], end)
            S[at + NEXT] = EMPTY
            S[at + SR] |= TXE
        else:
            S[at + SHIFTING] = EMPTY
            S[at + SR] |= TC


@njit(cache=True)
def _settle_receiver(S: State, unit: int, now: int) -> None:
    at, ring = USART + USART_STRIDE * unit, records.INPUT + unit
    while S[at + ARRIVING] <= now:
        value, end = records.take(S, ring), S[at + ARRIVING]
        if not _is_on(S, at, RE):
            S[at + LOST] += 1
        elif S[at + SR] & RXNE:  # section 30.3.3: what came before stays
            S[at + SR] |= ORE
            S[at + LOST] += 1
        else:
            S[at + DR] = _with_parity(S, at, value)
            S[at + SR] |= RXNE
        S[at + ARRIVING] = end + frame_cycles(S, unit) if records.waiting(S, ring) else rcc.NEVER
        S[at + IDLE_AT] = rcc.NEVER if records.waiting(S, ring) else end + frame_cycles(S, unit)
    if S[at + IDLE_AT] <= now:
        S[at + IDLE_AT] = rcc.NEVER
        if _is_on(S, at, RE):
            S[at + SR] |= IDLE


@njit(cache=True)
def settle(S: State, unit: int) -> None:
    """Send and receive up to the present."""
    _settle_transmitter(S, unit, now_cycles(S))
    _settle_receiver(S, unit, now_cycles(S))


@njit(cache=True)
def service(S: State) -> None:
    """Send and receive up to the present, all of them."""
    for unit in range(6):
        at = USART + USART_STRIDE * unit
        if S[at + SHIFTING] != EMPTY or S[at + ARRIVING] != rcc.NEVER or S[at + IDLE_AT] != rcc.NEVER:
            settle(S, unit)


@njit(cache=True)
def due(S: State) -> int:
    """CPU cycles of the next end of a frame that an interrupt is enabled for."""
    first = rcc.NEVER
    for unit in range(6):
        at = USART + USART_STRIDE * unit
        enabled = S[at + CR1]
        if enabled & (TXE | TC) and S[at + SHIFTING] != EMPTY:
            first = min(first, S[at + SHIFT_END])
        if enabled & RXNE:
            first = min(first, S[at + ARRIVING])
        if enabled & IDLE:
            first = min(first, S[at + IDLE_AT], S[at + ARRIVING])
    return first


@njit(cache=True)
def line(S: State, unit: int) -> bool:
    """Level of an interrupt line: the enable bits of CR1 lie at their flags' places."""
    at = USART + USART_STRIDE * unit
    flags, enabled = S[at + SR], S[at + CR1] & (IDLE | RXNE | TC | TXE)
    if flags & ORE:
        flags |= RXNE
    return flags & enabled != 0


@njit(cache=True)
def begin_input(S: State, unit: int) -> None:
    """Bytes have been put into the input ring: the first one begins now unless one is on its way."""
    at = USART + USART_STRIDE * unit
    settle(S, unit)
    if S[at + ARRIVING] == rcc.NEVER and records.waiting(S, records.INPUT + unit):
        S[at + ARRIVING] = now_cycles(S) + frame_cycles(S, unit)
        S[at + IDLE_AT] = rcc.NEVER
    S[ATTEND] = 1


@njit(cache=True)
def peek(S: State, unit: int, offset: int) -> int:
    """Value of the register at `offset`, -1 if it is not modelled; nothing comes of it."""
    settle(S, unit)
    return S[USART + USART_STRIDE * unit + offset // 4] if offset <= 0x18 else -1


@njit(cache=True)
def read(S: State, unit: int, offset: int) -> int:
    """Read a register: SR, then DR, clears the error flags and IDLE; DR alone RXNE (section 30.6.1)."""
    at, value = USART + USART_STRIDE * unit, peek(S, unit, offset)
    if offset == 0x00:
        S[at + SEEN] = value
    elif offset == 0x04:
        S[at + SR] &= ~(S[at + SEEN] & _ERRORS | RXNE)
        S[at + SEEN] = 0
    return value


@njit(cache=True)
def _send(S: State, unit: int, value: int) -> None:
    """DR written: to the line if it is free, else behind what is on it."""
    at = USART + USART_STRIDE * unit
    if S[at + SEEN] & TC:  # read of SR, then write of DR
        S[at + SR] &= ~TC
    S[at + SEEN] = 0
    if not _is_on(S, at, TE):
        return
    value &= _data_mask(S, at)
    if S[at + SHIFTING] == EMPTY:
        _shift(S, unit, value, now_cycles(S))
    else:
        S[at + NEXT] = value
        S[at + SR] &= ~TXE


@njit(cache=True)
def _control(S: State, unit: int, value: int) -> None:
    """CR1 written: an idle frame goes out first when the transmitter is switched on (section 30.3.2)."""
    at = USART + USART_STRIDE * unit
    on = _is_on(S, at, TE)
    S[at + CR1] = value & 0xBFFF
    if _is_on(S, at, TE):
        if not on:
            _shift(S, unit, PREAMBLE, now_cycles(S))
    elif on:
        S[at + NEXT] = S[at + SHIFTING] = EMPTY
        S[at + SR] |= TXE | TC


@njit(cache=True)
def write(S: State, unit: int, offset: int, value: int) -> bool:
    """Write the register at `offset`; False if it is not modelled."""
    at, register = USART + USART_STRIDE * unit, offset // 4
    settle(S, unit)
    S[ATTEND] = 1
    if register == SR:  # of these two a zero clears, the others only go by DR
        S[at + SR] &= value | ~(TC | RXNE)
    elif register == DR:
        _send(S, unit, value)
    elif register == CR1:
        _control(S, unit, value)
    elif register <= GTPR:
        S[at + register] = value & 0xFFFF
    else:
        return False
    for which, bits in _UNMODELLED:  # noqa: SIM110  # compiled code has no generators
        if register == which and value & bits:
            return False
    return True

"""bxCAN's 28 filter banks, shared by both controllers (RM0090 section 32.7.4); registers: 32.9.4."""

from targets.jit import njit
from targets.mcu.bxcan.registers import ALL_BANKS, BANKS, CAN2SB, FINIT, FMR_RESET
from targets.mcu.state import (
    CAN_FA1R,
    CAN_FFA1R,
    CAN_FILTER,
    CAN_FM1R,
    CAN_FMR,
    CAN_FS1R,
    RCC_ENABLE,
    State,
)

NONE = -1
_CAN2EN = 1 << 26
_APB1ENR = RCC_ENABLE + 4


def reset(S: State) -> None:
    """Reset values: initialisation mode, no bank active."""
    S[CAN_FM1R : CAN_FILTER + 2 * BANKS] = 0
    S[CAN_FMR] = FMR_RESET


@njit(cache=True)
def _first_bank(S: State, c: int) -> int:
    return S[CAN_FMR] >> 8 & 0x3F if c else 0


@njit(cache=True)
def _end_bank(S: State, c: int) -> int:
    """One past the controller's last bank.

    FIDELITY: with CAN2SB = 0 the manual leaves CAN1 without banks; on an STM32F205 whose CAN2 was not in use
    CAN1 was seen to go on receiving (community.st.com, July 2016). So it does here while CAN2 has no clock.
    """
    start = S[CAN_FMR] >> 8 & 0x3F
    if c or (start == 0 and S[_APB1ENR] & _CAN2EN == 0):
        return BANKS
    return min(start, BANKS)


@njit(cache=True)
def _which(S: State, bank: int, wide: int, listed: int, rir: int) -> int:
    """Which of the bank's filters lets a frame in, NONE if none does; rir is its identifier register."""
    one, two = S[CAN_FILTER + 2 * bank], S[CAN_FILTER + 2 * bank + 1]
    if wide:
        # bit 0 is no part of an identifier
        if not listed:
            return 0 if (rir ^ one) & two & 0xFFFFFFFE == 0 else NONE
        if (rir ^ one) & 0xFFFFFFFE == 0:
            return 0
        return 1 if (rir ^ two) & 0xFFFFFFFE == 0 else NONE
    # 16 bits: STID[10:0] RTR IDE EXID[17:15]
    short = (rir >> 21 << 5) | (rir >> 1 & 1) << 4 | (rir >> 2 & 1) << 3 | rir >> 18 & 7
    if not listed:
        if (short ^ one) & (one >> 16) & 0xFFFF == 0:
            return 0
        return 1 if (short ^ two) & (two >> 16) & 0xFFFF == 0 else NONE
    for k in range(4):
        word = one if k < 2 else two
        if short == word >> (16 * (k & 1)) & 0xFFFF:
            return k
    return NONE


@njit(cache=True)
def match(S: State, c: int, rir: int) -> int:
    """FIFO << 8 | filter match index of the filter that takes a frame, NONE if none does.

    32 bits before 16, list before mask, then the lower bank. The index counts the filters of all banks of
    that FIFO, active or not (figure 343), from the controller's first bank on. Between filters of different
    FIFOs, whose numbers cannot be compared, the bank decides.
    """
    if S[CAN_FMR] & FINIT:
        return NONE
    found, best = NONE, 4
    numbers0, numbers1 = 0, 0  # filters counted so far, by FIFO
    for bank in range(_first_bank(S, c), _end_bank(S, c)):
        wide, listed, fifo = S[CAN_FS1R] >> bank & 1, S[CAN_FM1R] >> bank & 1, S[CAN_FFA1R] >> bank & 1
        rank = (0 if wide else 2) + (0 if listed else 1)
        if rank < best and S[CAN_FA1R] >> bank & 1:
            which = _which(S, bank, wide, listed, rir)
            if which != NONE:
                best = rank
                found = fifo << 8 | (numbers1 if fifo else numbers0) + which
        filters = (1 if wide else 2) * (2 if listed else 1)
        if fifo:
            numbers1 += filters
        else:
            numbers0 += filters
    return found


@njit(cache=True)
def read(S: State, offset: int) -> int:
    """Value of the filter register at `offset` of CAN1, -1 if there is none."""
    if offset == 0x200:
        return S[CAN_FMR]
    if offset == 0x204:
        return S[CAN_FM1R]
    if offset == 0x20C:
        return S[CAN_FS1R]
    if offset == 0x214:
        return S[CAN_FFA1R]
    if offset == 0x21C:
        return S[CAN_FA1R]
    if 0x240 <= offset < 0x240 + 8 * BANKS:
        return S[CAN_FILTER + (offset - 0x240) // 4]
    return -1


@njit(cache=True)
def write(S: State, offset: int, value: int) -> bool:
    """Write the filter register at `offset` of CAN1; False if there is none.

    Mode, scale and assignment take writes with FINIT set only, a bank's filters also while it is inactive.
    """
    unlocked = S[CAN_FMR] & FINIT != 0
    if offset == 0x200:
        S[CAN_FMR] = FMR_RESET & ~(FINIT | CAN2SB) | value & (FINIT | CAN2SB)
    elif offset in (0x204, 0x20C, 0x214):
        if unlocked:
            slot = CAN_FM1R if offset == 0x204 else CAN_FS1R if offset == 0x20C else CAN_FFA1R
            S[slot] = value & ALL_BANKS
    elif offset == 0x21C:
        S[CAN_FA1R] = value & ALL_BANKS
    elif 0x240 <= offset < 0x240 + 8 * BANKS:
        word = (offset - 0x240) // 4
        if unlocked or not S[CAN_FA1R] >> (word // 2) & 1:
            S[CAN_FILTER + word] = value
    else:
        return False
    return True

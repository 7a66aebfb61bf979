"""The emulated MCU's state beside memory and core registers: one int64 array, and where things lie in it.

Devices, hooks and the run loop are compiled functions over this array; Python looks at it only between runs.
Copying it (with memory and registers) is a snapshot. Belongs here: the layout. Never: behaviour.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

State = NDArray[np.int64]


class HasState(Protocol):
    """An emulated MCU, or what passes for one: its state is all that a device's face to Python needs."""

    state: State


# Engine
UC = 0  # unicorn's handle
SELF = 1  # address of this array
FN_START, FN_STOP, FN_REG_READ, FN_REG_WRITE, FN_MEM_READ, FN_MEM_WRITE = range(2, 8)
SCRATCH = 8  # one register passing through

# Time. CPU cycles since reset; nanoseconds follow from the clock of the moment.
CYCLES = 16
DEADLINE = 17  # cycles at which to stop
BASE_CYCLES = 18  # cycles and nanoseconds when the clock was last set
BASE_NS = 19
HZ = 20
UNTIL_NS = 21
NEXT = 22  # address that follows the last block in memory: any other one is a branch taken
BRANCH_PENALTY = 23
ENTRY_CYCLES = 24
EXIT_CYCLES = 25
TAIL_CYCLES = 26
HALFWORDS = 27  # of code executed: a measure of work
CODE_HALFWORDS = 28  # that have a cost
RAM_BLOCKS = 29  # executed outside flash

# Run loop
ATTEND = 32  # 1: stop at the next block; 2: stop when PRIMASK clears
STOPPED = 33  # a hook stopped the engine (else it was WFI)
SLEEPING = 34
PC = 35
ERROR = 36  # unicorn's error code
RETURNING = 37  # an EXC_RETURN was executed
RESET_REQUEST = 38

# Cortex-M system control
VTOR = 48
CPACR = 49
DEMCR = 50
DWT_CTRL = 51
DWT_OFFSET = 52  # CYCCNT = CYCLES - offset
SHCSR = 53
CCR = 54
SCR = 55
FPCCR = 56

# NVIC: external interrupts 0..95, three words of 32
NVIC_ENABLED = 64
NVIC_LATCHED = 67
NVIC_PRIORITY = 80  # 96 of them
ACTIVE_DEPTH = 176
ACTIVE = 177  # exception numbers, nested; 16 deep

# RCC and flash interface
RCC_CR = 208
RCC_PLLCFGR = 209
RCC_CFGR = 210
RCC_ENABLE = 216  # AHB1, AHB2, AHB3, reserved, APB1, APB2
FLASH_ACR = 224

# GPIO A..I: MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, -, -, AFRL, AFRH
GPIO = 240
GPIO_STRIDE = 10

# bxCAN 1
CAN_MCR = 336
CAN_MSR = 337
CAN_TSR = 338
CAN_IER = 339
CAN_ESR = 340
CAN_BTR = 341
CAN_TX_NEW = 342  # mailboxes whose request Python has not seen, a bit each
CAN_TX_NS = 343  # three: when the request was made
CAN_MAILBOX = 348  # three of TIR, TDTR, TDLR, TDHR
CAN_FIFO_COUNT = 360  # two
CAN_FIFO_FLAGS = 362  # two: FULL and FOVR
CAN_FIFO = 364  # two of three of RIR, RDTR, RDLR, RDHR
CAN_FMR = 388
CAN_FM1R = 389
CAN_FS1R = 390
CAN_FFA1R = 391
CAN_FA1R = 392
CAN_FILTER = 400  # 28 of FR1, FR2
CAN_LOST = 456  # frames that no filter let in, or that came while the controller was not on the bus

# Access to what is not modelled: count of entries, then address and times
UNMODELLED = 464
UNMODELLED_MAX = 64

# Stack frame in transit: 26 words of 32 bits
STACK = 600

# 1024..1279: core and system
# 1280..1535: bxCAN
# 1536..3071: other devices
RESET_CAUSE = 1536  # who asked for the reset: see reset.py

# RCC beyond the registers above
RCC_SOURCE = 1538  # SWS: the clock that drives SYSCLK
RCC_CIR = 1539
RCC_BDCR = 1540
RCC_CSR = 1541
RCC_SSCGR = 1542
RCC_PLLI2SCFGR = 1543
RCC_READY_NS = 1544  # six: when LSI, LSE, HSI, HSE, PLL and PLLI2S are ready, in the order of CIR's bits
RCC_READY_SEEN = 1550  # those that have been ready before: CIR reports the moment, not the state
RCC_LOW_POWER = 1552  # six, as RCC_ENABLE
RCC_RESET = 1558  # six
RCC_WARNINGS = 1564  # eight pairs: times, and the last value

PWR_CR = 1580
PWR_CSR = 1581
SYSCFG = 1584  # MEMRMP, PMC, EXTICR1 to 4, CMPCR
EXTI = 1592  # IMR, EMR, RTSR, FTSR, SWIER, PR
CRC_DR = 1600
CRC_IDR = 1601
IWDG_PR = 1604
IWDG_RLR = 1605
IWDG_UNLOCKED = 1606
IWDG_RUNNING = 1607
IWDG_EXPIRES_NS = 1608
IWDG_PVU_NS = 1609  # until when PVU and RVU stand
IWDG_RVU_NS = 1610
WWDG_CFR = 1612
WWDG_SR = 1613
WWDG_ACTIVE = 1614  # WDGA
WWDG_COUNT = 1615  # T at cycle WWDG_BASE
WWDG_BASE = 1616
WWDG_PHASE = 1617  # PCLK1 clocks into the count, while its clock is off or changing
DBGMCU = 1620  # CR, APB1_FZ, APB2_FZ
ITM_TER = 1624
ITM_TPR = 1625
ITM_TCR = 1626
ITM_UNLOCKED = 1627
TPIU = 1628  # CSPSR, ACPR, SPPR, FFCR

# GPIO beyond the registers: per port what the registers come to, as masks of 16 pins
GPIO_PINS = 1640
GPIO_PINS_STRIDE = 12

# Accesses to devices whose clock is off, a count for each bit of RCC_ENABLE
UNCLOCKED = 1760  # six words of 32 bits

# TIM2 to TIM5: registers at their offset / 4, then what counts
TIM = 1952
TIM_STRIDE = 48
TIM_OUTPUT = 2144  # four of four: level of each channel's output, -1 while off

# USART1, 2, 3, UART4, 5, USART6
USART = 2160
USART_STRIDE = 24

# For each address region that devices answer in: the address of this array, and the region's base
REGION = 2400

SRAM_HOST = 2420  # address of SRAM1 in this process

# Rings of records in an array of their own: address, capacity, words a record, records so far, records taken
RINGS = 2304
RING_STRIDE = 5

# 3072..4095: time
# The same count as CYCLES with the timing model's optimistic and its pessimistic figures
CYCLES_MIN = 3072
CYCLES_MAX = 3073

# Cycles before the instruction at (flash origin + 2 i)
COST = 4096


def allocate(flash_bytes: int) -> State:
    """A zeroed state for `flash_bytes` of executable flash, knowing its own address."""
    state = np.zeros(COST + flash_bytes // 2 + 1, dtype=np.int64)
    state[SELF] = state.ctypes.data
    return state


def words(state: State, at: int, count: int) -> list[int]:
    """`count` entries from `at` as Python integers."""
    return [int(value) for value in state[at : at + count]]


def as_pointer(state: State) -> Any:
    """The address of the state for a C callback's user data."""
    return int(state[SELF])

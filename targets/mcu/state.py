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
FN_START, FN_STOP, FN_REG_READ, FN_REG_WRITE = range(2, 6)
SCRATCH = 8  # one register passing through

# Time. CPU cycles since reset; nanoseconds follow from the clock of the moment.
CYCLES = 16
DEADLINE = 17  # cycles at which to stop
BASE_CYCLES = 18  # cycles and nanoseconds when the clock was last set
BASE_NS = 19
HZ = 20
UNTIL_NS = 21
NEXT = 22  # address that follows the last block in memory: any other one is a branch taken
ENTRY_CYCLES = 24
EXIT_CYCLES = 25
TAIL_CYCLES = 26

# Run loop
ATTEND = 32  # what the block hook looks after: see attention.py; 1 stops at the next block
STOPPED = 33  # a hook stopped the engine, and which (else it was WFI)
SLEEPING = 34  # by WFI or WFE: see exceptions.py
PC = 35
ERROR = 36  # the run has ended with the fault recorded: see faults.py
RESET_REQUEST = 38
CALL_END = 47  # address at which a called function's return ends the run

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
ACTIVE = 177  # exception numbers, nested: 16 priorities, HardFault and NMI

# RCC and flash interface
RCC_CR = 208
RCC_PLLCFGR = 209
RCC_CFGR = 210
RCC_ENABLE = 216  # AHB1, AHB2, AHB3, reserved, APB1, APB2
FLASH_ACR = 224

# GPIO A..I: MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, -, -, AFRL, AFRH
GPIO = 240
GPIO_STRIDE = 10

# Access to what is not modelled: count of entries, then address and times
UNMODELLED = 464
UNMODELLED_MAX = 64

# 1024..1279: core and system
COUNT = 1025  # instructions to run before stopping, 0 for any number
BREAK_PASSED = 1026  # address of a breakpoint that does not stop this once
SET_UP = 1028  # hooks the machine must install before going on: see hooks.py
TRAP = 1029  # unicorn's exception number
THUMB = 1030  # the T bit: the engine runs with it set whatever it was
HALT_ON_BKPT = 1031  # a debugger takes BKPT instructions
FPU_WATCH = 1032  # how the use of an FPU that is off is found out: see attention.py
MASKED_NS = 1033  # since when an exception that could run is masked, or the handler of a fault runs; or NEVER
FAULTED_NS = 1034
PATIENCE_NS = 1035  # how long either may last
WAITING = 1036  # the exception that is masked
EVENT = 1037  # event register of WFE and SEV
PENDING_SEEN = 1038  # four words: what was pending when SEVONPEND was looked at last
ON_FAULT = 1042  # see faults.py
ACCESS = 1043  # of the access that memory refused: read, write or fetch
ACCESS_ADDRESS = 1044

# Exceptions 1 to 15
SYSTEM_PENDING = 1045  # a bit each
SYSTEM_PRIORITY = 1048  # sixteen
PRIGROUP = 1064
ACTLR = 1065
FPCAR = 1066
CFSR = 1067
HFSR = 1068
DFSR = 1069
MMFAR = 1070
BFAR = 1071

SYST_CTRL = 1074  # ENABLE, TICKINT, CLKSOURCE, COUNTFLAG
SYST_LOAD = 1075
SYST_VALUE = 1076  # the count at cycle SYST_BASE
SYST_BASE = 1077
SYST_DUE = 1078  # cycle at which it next comes to zero

MPU_CTRL = 1080
MPU_RNR = 1081
MPU_RBAR = 1082  # eight
MPU_RASR = 1090  # eight

# The last fault: its kind, the address it is about, the exception it became; R0 to R12, SP, LR, PC and xPSR
FAULT_KIND = 1100
FAULT_ADDRESS = 1101
FAULT_EXCEPTION = 1102
FAULT_COUNT = 1103
FAULT_ACCESS = 1104
FAULT_REGISTERS = 1105  # seventeen

# Where memories lie on the host: three of first address, size, host address; the first of them is the flash
MEMORIES = 1124

# 1280..1535: bxCAN. Words of controller 1; those of controller 2 lie CAN_STRIDE further on.
CAN_STRIDE = 80
CAN_MCR = 1280
CAN_MSR = 1281  # INAK, SLAK, ERRI, WKUI, SLAKI; the rest is computed
CAN_TSR = 1282  # without CODE and LOW
CAN_IER = 1283
CAN_LEC = 1284  # last error code
CAN_BTR = 1285
CAN_TEC = 1286
CAN_REC = 1287
CAN_BOFF = 1288  # 1: bus-off
CAN_LOST = 1289  # frames that no filter let in, or that came while the controller was not on the bus
CAN_FIFO_COUNT = 1290  # two
CAN_FIFO_FLAGS = 1292  # two: FULL and FOVR
CAN_RELEASED = 1294  # two: CPU cycles until which RFOM reads as set
CAN_MAILBOX = 1296  # three of TIR, TDTR, TDLR, TDHR
CAN_FIFO = 1308  # two of three of RIR, RDTR, RDLR, RDHR
CAN_TX_NS = 1332  # three: when the request was made
CAN_TX_ORDER = 1335  # three: which request it was
CAN_REQUESTS = 1338  # so many so far
CAN_SENDING = 1339  # mailbox + 1 on the wire, 0 if none
CAN_BUSY = 1340  # the bus: 0 idle, 1 a frame that this controller takes no part in, 2 one that it does
CAN_SOF_NS = 1341  # start of that frame
CAN_SYNC = 1342  # sequences of 11 recessive bits still to be seen before normal mode
CAN_RECOVER = 1343  # and before the end of bus-off
CAN_WATCH_NS = 1344  # start of the first sequence not counted yet
CAN_EPOCH_NS = 1345  # start of the bit counter for time stamps
CAN_LOOP_NS = 1346  # loop-back: when its frame ends, or the next one may start
CAN_LOOP_FREE_NS = 1347
CAN_STUCK_NS = 1348  # when a request made in bus-off has waited too long
CAN_STUCK_MAILBOX = 1349
CAN_DUE_NS = 1350  # the earliest of these instants
CAN_BITRATE = 1351  # of the bus it is attached to, 0 if to none
# Shared by both controllers
# Mailboxes whose request Python has not seen: bits 0..2 and 8..10; 7 and 15: CAN_STUCK_NS has come
CAN_TX_NEW = 1440
CAN_FMR = 1441
CAN_FM1R = 1442
CAN_FS1R = 1443
CAN_FFA1R = 1444
CAN_FA1R = 1445
CAN_FILTER = 1446  # 28 of FR1, FR2
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


# Rings of records in an array of their own: address, capacity, words a record, records so far, records taken
RINGS = 2304
RING_STRIDE = 5

# 3072..3583: time, and what the cycle model remembers
TIME = 3072
# The same count as CYCLES with the timing model's optimistic and its pessimistic figures
CYCLES_MIN = 3072
CYCLES_MAX = 3073
INSTRUCTIONS = 3074  # executed, those that an IT block skips included
FLOW = 3075  # state of the pipeline at the end of the last block: a row of FLOWS
BLOCK = 3076  # the block charged last: its first address, the one past it, and how it was entered
BLOCK_END = 3077
BLOCK_FLOW = 3078
BLOCK_TAKEN = 3079
SITE = 3080  # the block's last instruction known to have reached a device
LATE = 3081  # cycles charged already that lie behind that access: model, optimistic, pessimistic
DECODE_AT = 3084  # a block that has no rows yet: address, bytes
DECODE_SIZE = 3085
FLOWS_USED = 3086
BLOCK_CYCLES = 3087  # of the block that runs, as its memory has them
PIPELINE = 3088  # figures of timing.toml, SETS rows
ART_LINE = 3180  # the line in the fetch unit
ART_CLOCK = 3181
AGU_READY = 3184  # scratch of the simulation: 16 core registers, 32 FP registers, fetch times
FP_READY = 3200
ISSUED = 3232
FREED = 3236
RESULT = 3240  # of one block: the state at its end, three words; then those of all sets

# Pipeline states: nine words each, three for every set of figures; a row's number is its name
FLOWS = 4096
FLOW_WORDS = 9
FLOWS_MAX = 2048

# Memory of blocks: key; cycles of the three sets, 20 bits each; next state and instructions
MEMO = FLOWS + FLOW_WORDS * FLOWS_MAX
MEMO_WORDS = 4
MEMO_MAX = 4096

# Rows of decoded instructions by halfword: flash, then SRAM
ROWS = MEMO + MEMO_WORDS * MEMO_MAX
ROW_WORDS = 8
FLASH_HALFWORDS = 0x80000
SRAM_HALFWORDS = 0x10000

# The flash's instruction cache: slot of each line plus one, lines of the slots, when each was used last
FLASH_LINES = 0x10000
ART_MAP = ROWS + ROW_WORDS * (FLASH_HALFWORDS + SRAM_HALFWORDS)
ART_SLOTS = ART_MAP + FLASH_LINES
ART_STAMPS = ART_SLOTS + 64

SIZE = ART_STAMPS + 64


def allocate() -> State:
    """A zeroed state that knows its own address. Most of its pages are never touched."""
    state = np.zeros(SIZE, dtype=np.int64)
    state[SELF] = state.ctypes.data
    return state


def words(state: State, at: int, count: int) -> list[int]:
    """`count` entries from `at` as Python integers."""
    return [int(value) for value in state[at : at + count]]


def as_pointer(state: State) -> Any:
    """The address of the state for a C callback's user data."""
    return int(state[SELF])

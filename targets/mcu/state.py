"""The emulated MCU's state beside memory and core registers: one int64 array, and where things lie in it.

Devices, hooks and the run loop are compiled functions over this array; Python looks at it only between runs.
Copying it (with memory and registers) is a snapshot. Belongs here: the layout. Never: behaviour.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

State = NDArray[np.int64]

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
RCC_HSE_AT = 211  # nanoseconds at which the oscillator is ready
RCC_PLL_AT = 212
RCC_ENABLE = 216  # AHB1, AHB2, AHB3, reserved, APB1, APB2
FLASH_ACR = 224

# GPIO A..I: MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, -, -, AFRL, AFRH
GPIO = 240
GPIO_STRIDE = 10

# Access to what is not modelled: count of entries, then address and times
UNMODELLED = 464
UNMODELLED_MAX = 64

# Stack frame in transit: 26 words of 32 bits
STACK = 600

# 1024..1279: core and system
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
CAN_RELEASED_NS = 1294  # two: until when RFOM reads as set
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

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
BRANCH_PENALTY = 23
ENTRY_CYCLES = 24
EXIT_CYCLES = 25
TAIL_CYCLES = 26
HALFWORDS = 27  # of code executed: a measure of work
CODE_HALFWORDS = 28  # that have a cost
RAM_BLOCKS = 29  # executed outside flash

# Run loop
ATTEND = 32  # what the block hook looks after: see attention.py; 1 stops at the next block
STOPPED = 33  # a hook stopped the engine, and which (else it was WFI)
SLEEPING = 34  # by WFI or WFE: see exceptions.py
PC = 35
ERROR = 36  # the run has ended with the fault recorded: see faults.py
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
ACTIVE = 177  # exception numbers, nested: 16 priorities, HardFault and NMI

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

# 1024..1279: core and system
BLOCK = 1024  # start of the basic block charged last
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

# 1280..1535: bxCAN
# 1536..3071: other devices
RESET_CAUSE = 1536  # who asked for the reset
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

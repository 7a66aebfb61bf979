"""Faults (ARMv7-M B1.5.14): their kinds, what the fault status registers say of them, and in words.

A kind below 32 is the number of its bit in CFSR. Belongs here: names and tables. Never: the run loop.
"""

# Kinds: bits of CFSR (B3.2.15) ...
FETCH_XN, DATA_VIOLATION, FETCH_BUS, DATA_BUS, UNSTACKING, STACKING = 0, 1, 8, 9, 11, 12
UNDEFINED, INVALID_STATE, INVALID_RETURN, NO_COPROCESSOR, UNALIGNED, DIVIDE_BY_ZERO = 16, 17, 18, 19, 24, 25
MMARVALID, BFARVALID = 1 << 7, 1 << 15
# ... and what has none there
VECTOR_TABLE, BREAKPOINT, SUPERVISOR_CALL, FLASH_WRITE, MASKED, DEAD_END, UNKNOWN = range(32, 39)

# HFSR (B3.2.16)
VECTTBL, FORCED, DEBUGEVT = 1 << 1, 1 << 30, 1 << 31
# DFSR
BKPT = 1 << 1

# ON_FAULT
STOP, TAKE = 0, 1

# ERROR: the run ended with the fault, or its handler has been running for too long
ENDED, HANDLER_STUCK = 1, 2

# ACCESS
READ, WRITE, FETCH = 0, 1, 2
ACCESS_WORDS = ("read", "write", "instruction fetch")

# SET_UP: hooks on single instructions that the firmware has come to need, or needs no longer
DIVISIONS, FPU_OFF, FPU_ON = 1, 2, 4

LOCKUP = 0
"""FAULT_EXCEPTION of a fault that no handler can take."""

KINDS = {
    FETCH_XN: ("execute-never", "execution of a region that holds no code"),
    DATA_VIOLATION: ("protection", "{access} at {address} against the memory protection"),
    FETCH_BUS: ("fetch", "instruction fetch outside memory"),
    DATA_BUS: ("access", "{access} outside memory, at {address}"),
    FLASH_WRITE: ("flash-write", "write to flash, at {address}"),
    UNSTACKING: ("stack", "exception return with a stack outside memory, at {address}"),
    STACKING: ("stack", "stack overflow: no memory for an exception frame at {address}"),
    UNDEFINED: ("undefined", "undefined instruction"),
    INVALID_STATE: ("arm-state", "ARM state: a branch to an even address, or an empty vector"),
    INVALID_RETURN: ("return", "invalid exception return {address}"),
    NO_COPROCESSOR: ("coprocessor", "instruction for a coprocessor that is absent or off (CPACR)"),
    UNALIGNED: ("unaligned", "unaligned access"),
    DIVIDE_BY_ZERO: ("division", "division by zero"),
    VECTOR_TABLE: ("vector-table", "vector table outside memory, at {address}"),
    BREAKPOINT: ("breakpoint", "breakpoint instruction without a debugger"),
    SUPERVISOR_CALL: ("supervisor-call", "supervisor call where its priority does not let it be taken"),
    UNKNOWN: ("emulator", "the emulator stopped with error {address}"),
}
"""Kind -> a word for programs, and words for people."""

CFSR_BITS = {
    **{0: "IACCVIOL", 1: "DACCVIOL", 3: "MUNSTKERR", 4: "MSTKERR", 5: "MLSPERR", 7: "MMARVALID"},
    **{8: "IBUSERR", 9: "PRECISERR", 10: "IMPRECISERR", 11: "UNSTKERR", 12: "STKERR", 13: "LSPERR"},
    **{15: "BFARVALID", 16: "UNDEFINSTR", 17: "INVSTATE", 18: "INVPC", 19: "NOCP", 24: "UNALIGNED"},
    25: "DIVBYZERO",
}
HFSR_BITS = {1: "VECTTBL", 30: "FORCED", 31: "DEBUGEVT"}

EXCEPTIONS = {
    **{LOCKUP: "lockup", 2: "NMI", 3: "HardFault", 4: "MemManage", 5: "BusFault", 6: "UsageFault"},
    **{11: "SVCall", 12: "DebugMonitor", 14: "PendSV", 15: "SysTick"},
}
"""Names of the system exceptions (B1.5.2)."""


def exception_name(number: int) -> str:
    """`SysTick`, or `interrupt 20`."""
    return EXCEPTIONS.get(number, f"interrupt {number - 16}")


def flags(cfsr: int, hfsr: int) -> str:
    """The names of the bits that are set."""
    tables = ((cfsr, CFSR_BITS), (hfsr, HFSR_BITS))
    return " ".join(name for value, bits in tables for bit, name in bits.items() if value >> bit & 1)

"""Where the STM32F405 has memory (RM0090 section 2.3)."""

FLASH, FLASH_SIZE = 0x08000000, 0x100000
ALIAS = 0x00000000
"""Where the boot pins make flash appear a second time (RM0090 section 2.4)."""
SRAM, SRAM_SIZE = 0x20000000, 0x20000  # SRAM1 of 112 kB, SRAM2 of 16
SRAM1_END = 0x2001C000
CCM, CCM_SIZE = 0x10000000, 0x10000  # core-coupled memory: data only

REGIONS = ((FLASH, FLASH_SIZE), (ALIAS, FLASH_SIZE), (SRAM, SRAM_SIZE), (CCM, CCM_SIZE))


def holds(address: int, size: int) -> bool:
    """Whether one memory holds all of these bytes."""
    return any(base <= address and address + size <= base + room for base, room in REGIONS)


def ends_in_ram(address: int) -> bool:
    """Whether a stack may begin at `address`: some RAM lies below it."""
    return any(base < address <= base + room for base, room in ((SRAM, SRAM_SIZE), (CCM, CCM_SIZE)))


def in_flash(address: int) -> int:
    """The address in flash proper of an address in its alias; any other one as it is."""
    return address - ALIAS + FLASH if ALIAS <= address < ALIAS + FLASH_SIZE else address

"""Names of registers by address."""

import pytest

from targets.mcu import bxcan, flash, gpio, rcc
from targets.mcu.registers import _table, name


@pytest.mark.parametrize(
    ("address", "named"),
    [
        (0x40000024, "TIM2_CNT"),
        (0x40004408, "USART2_BRR"),
        (0x40012108, "ADC2_CR2"),
        (0x40012308, "ADC_CDR"),
        (0x40023C00, "FLASH_ACR"),
        (0x40026410, "DMA2_S0CR"),
        (0x40006440, "CAN1+0x40"),
        (0x40024010, "BKPSRAM+0x10"),
        (0x50000004, "USB_OTG_FS+0x4"),
        (0xE000E014, "SysTick_LOAD"),
        (0xE000ED08, "SCB_VTOR"),
        (0xE000ED94, "MPU_CTRL"),
        (0xE000EDFC, "CoreDebug_DEMCR"),
        (0xE000EF34, "FPU_FPCCR"),
        (0xE0001004, "DWT_CYCCNT"),
        (0x40030000, ""),
        (0x20000000, ""),
        (0xFFFFFFFF, ""),
    ],
)
def test_names(address, named):
    """A register has its name, one without a name its peripheral's and its offset, other addresses none."""
    assert name(address) == named


def test_devices_are_where_the_table_says():
    """The modelled devices' own base addresses are those of the table."""
    bases = {row[2]: row[0] for row in _table()[0]}
    assert (bases["CAN1"], bases["GPIOA"]) == (bxcan.BASE, gpio.BASE)
    assert (bases["RCC"], bases["FLASH"]) == (rcc.BASE, flash.BASE)


def test_table_is_in_order():
    """No peripheral begins where another one does, and every kind is known."""
    rows, kinds = _table()
    bases = [row[0] for row in rows]
    assert len(set(bases)) == len(bases)
    assert {row[3] for row in rows} - {""} == set(kinds)

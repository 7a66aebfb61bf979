"""The ECU's C firmware: `core/` runs on any machine, `stm32f405/` is the shell around it on the MCU."""

from pathlib import Path

HERE = Path(__file__).parent
ELF = {role: HERE / "elf" / f"{role}.elf" for role in ("ifd", "soft_sensor")}
"""The shipped images, one a role."""

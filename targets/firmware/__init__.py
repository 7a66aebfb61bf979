"""The ECU's C firmware: `core/` runs on any machine, `stm32f405/` is the shell around it on the MCU."""

from pathlib import Path

HERE = Path(__file__).parent
ELF = {role: HERE / "elf" / f"{role}.elf" for role in ("ifd", "soft_sensor")}
"""The shipped images, one a role."""

STEP_ELF = {
    "initial": HERE / "elf" / "initial.elf",
    "compiler": HERE / "elf" / "compiler.elf",
    "final": ELF["ifd"],
}
"""The IFD after steps 2, 3 and 4 of section V.5.2; `steps/` and `variants.py` say how they differ."""

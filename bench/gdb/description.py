"""What GDB is told of the machine: the registers of an ARMv7E-M with FPU, in the order of the `g` packet.

Source: Debugging with GDB, appendix G.5.3 "ARM Features". Belongs here: names and widths. Never: values.
"""

from typing import NamedTuple


class Register(NamedTuple):
    """A register as GDB names it: its width in bits and GDB's type for it."""

    name: str
    bits: int = 32
    type: str = "int"


FEATURES: dict[str, tuple[Register, ...]] = {
    "org.gnu.gdb.arm.m-profile": (
        *(Register(f"r{k}") for k in range(13)),
        Register("sp", type="data_ptr"),
        Register("lr"),
        Register("pc", type="code_ptr"),
        Register("xpsr"),
    ),
    "org.gnu.gdb.arm.vfp": (
        *(Register(f"d{k}", 64, "ieee_double") for k in range(16)),
        Register("fpscr"),
    ),
    "org.gnu.gdb.arm.m-system": (
        Register("msp", type="data_ptr"),
        Register("psp", type="data_ptr"),
        Register("primask"),
        Register("basepri"),
        Register("faultmask"),
        Register("control"),
    ),
}

REGISTERS = tuple(register for group in FEATURES.values() for register in group)
"""All of them; GDB's number of a register is its place here."""


def target_xml() -> bytes:
    """The target description, as `qXfer:features:read:target.xml` hands it over."""
    lines = ['<?xml version="1.0"?>', '<!DOCTYPE target SYSTEM "gdb-target.dtd">', '<target version="1.0">']
    lines.append("<architecture>arm</architecture>")
    for feature, group in FEATURES.items():
        lines.append(f'<feature name="{feature}">')
        lines += [f'<reg name="{r.name}" bitsize="{r.bits}" type="{r.type}"/>' for r in group]
        lines.append("</feature>")
    return "\n".join([*lines, "</target>", ""]).encode()

"""For which core a file was built: its build attributes (ARM IHI 0045), and whether a Cortex-M4F is one."""

import struct

from targets.errors import FirmwareError
from targets.mcu.elf import SHT_ATTRIBUTES, Elf, text, uleb

_ARCHITECTURES = (
    *("before ARMv4", "ARMv4", "ARMv4T", "ARMv5T", "ARMv5TE", "ARMv5TEJ", "ARMv6", "ARMv6KZ"),
    *("ARMv6T2", "ARMv6K", "ARMv7", "ARMv6-M", "ARMv6S-M", "ARMv7E-M", "ARMv8-A", "ARMv8-R"),
    *("ARMv8-M.baseline", "ARMv8-M.mainline", "ARMv8.1-A", "ARMv8.2-A", "ARMv8.3-A", "ARMv8.1-M.mainline"),
    "ARMv9-A",
)
_CPU_NAME, _CPU_ARCH, _PROFILE, _ARM_ISA, _FP_ARCH = 5, 6, 7, 8, 10
_V7, _M_PROFILES, _FPV5 = 10, (11, 12, 13), (7, 8)


def check_core(tags: dict[int, int | str], source: str) -> None:
    """Refuse what was built for a core whose instructions a Cortex-M4F lacks."""
    arch, name = int(tags.get(_CPU_ARCH, 0)), str(tags.get(_CPU_NAME, ""))
    known = _ARCHITECTURES[arch] if arch < len(_ARCHITECTURES) else f"architecture {arch}"
    core = f"{name} ({known})" if name else known
    # An assembler that was told no core names the oldest one that has every instruction it met.
    untold = arch <= _V7 and not name
    thumb = not tags.get(_ARM_ISA) and tags.get(_PROFILE, 0) in (0, ord("M"))
    if not (arch in _M_PROFILES or (thumb and (untold or arch == _V7))):
        raise FirmwareError(f"{source}: built for {core}; a Cortex-M4 runs ARMv7E-M, ARMv7-M and ARMv6-M")
    if tags.get(_FP_ARCH) in _FPV5:
        raise FirmwareError(f"{source}: built for the FPv5 unit of {core}; a Cortex-M4F has FPv4-SP")


_TEXT_TAGS = (4, 5, 65, 67)  # CPU_raw_name, CPU_name, also_compatible_with, conformance


def read(file: Elf) -> dict[int, int | str]:
    """Build attributes of the whole file (ARM IHI 0045, section 2): tag -> value; empty if there are none."""
    found: dict[int, int | str] = {}
    for section in file.sections:
        if section.kind == SHT_ATTRIBUTES:
            try:
                _subsections(file.content(section), found)
            except (IndexError, ValueError, struct.error):
                break  # cut short: what has been read stands
    return found


def _subsections(data: bytes, found: dict[int, int | str]) -> None:
    at = 1  # format version 'A'
    while at + 4 < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        end = min(at + length, len(data))
        vendor = text(data, at + 4)
        k = data.index(0, at + 4) + 1
        while vendor == "aeabi" and k + 5 <= end:
            scope, (size,) = data[k], struct.unpack_from("<I", data, k + 1)
            if scope == 1:  # the file's; sections and symbols may differ, but no tool makes them
                _pairs(data[k + 5 : min(k + size, end)], found)
            k += max(size, 5)
        at += max(length, 5)


def _pairs(data: bytes, found: dict[int, int | str]) -> None:
    at = 0
    while at < len(data):
        tag, at = uleb(data, at)
        if tag == 32:  # compatibility: a number, then a text
            _, at = uleb(data, at)
        if tag in _TEXT_TAGS or (tag >= 32 and tag % 2) or tag == 32:
            found[tag] = text(data, at)
            at = data.index(0, at) + 1
        else:
            found[tag], at = uleb(data, at)

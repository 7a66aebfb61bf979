"""`bench firmware build` and `bench firmware size`: an image made, an image weighed.

Belongs here: options and what is printed. Never: a compiler's flag, a section's meaning.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

_LARGEST = 20


def build(
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The image to write.")],
    ecu: Annotated[str, typer.Option(help="The ECU: ifd or soft_sensor.")] = "ifd",
    code: Annotated[
        str, typer.Option(help="initial, compiler or final: STEP 2, 3 or 4 of the procedure.")
    ] = "final",
) -> None:
    """Build an image with arm-none-eabi-gcc; says whether it is the shipped one, byte for byte."""
    from hashlib import sha256

    from bench.whole import check_writable, whole
    from targets.errors import FirmwareError
    from targets.firmware import ELF, STEP_ELF
    from targets.firmware.build import build as make
    from targets.firmware.variants import STEPS

    if ecu not in ELF:
        raise FirmwareError(f"no ECU {ecu}; there are {', '.join(ELF)}")
    if code not in STEPS:
        raise FirmwareError(f"no code {code}; there are {', '.join(STEPS)}")
    check_writable(out)
    with whole(out) as part:
        make(ecu, part, STEPS[code])
        content = part.read_bytes()
    shipped = ELF[ecu] if code == "final" else STEP_ELF[code] if ecu == "ifd" else None
    same = "none is shipped"
    if shipped:
        same = "the shipped image" if shipped.read_bytes() == content else "not the shipped image"
    typer.echo(f"{out}: {len(content)} bytes, sha256 {sha256(content).hexdigest()}, {same}")


def size(
    elf: Annotated[
        Path | None, typer.Argument(metavar="ELF", help="Firmware image.  [default: the shipped IFD]")
    ] = None,
    json_out: Annotated[
        Path | None, typer.Option("--json", metavar="OUT", help="Write the figures as JSON.")
    ] = None,
) -> None:
    """What an image takes: flash, RAM, sections, the largest symbols."""
    from bench.whole import check_writable, whole
    from targets.firmware import ELF
    from targets.footprint import footprint

    if json_out:
        check_writable(json_out)
    path = elf or ELF["ifd"]
    found = footprint(path)
    typer.echo(f"{path}: {found.flash} bytes of flash, {found.ram} of RAM before any stack")
    for name, address, count, memory in found.sections:
        typer.echo(f"  {address:#010x}  {count:7d}  {name:<20} {memory}")
    typer.echo(f"largest of {len(found.symbols)} symbols:")
    for name, address, count in found.symbols[:_LARGEST]:
        typer.echo(f"  {address:#010x}  {count:7d}  {name}")
    if json_out:
        heads = ("name", "address", "bytes", "memory")
        result: dict[str, Any] = {
            "flash_bytes": found.flash,
            "ram_bytes": found.ram,
            "sections": [dict(zip(heads, row, strict=True)) for row in found.sections],
            "symbols": [dict(zip(heads, row, strict=False)) for row in found.symbols],
        }
        with whole(json_out) as part:
            part.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")

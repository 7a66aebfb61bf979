"""Small firmwares that are not this project's kind: other start-up, other layout, a C library."""

import subprocess
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

HERE = Path(__file__).parent
FLAGS = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-g", "-nostartfiles")


@cache
def built(
    name: str,
    *flags: str,
    code_at: int = 0x08000000,
    data_at: int = 0x20000000,
    stack: int = 0x2001C000,
) -> Path:
    """The ELF of `name`.c behind the start-up code, built once a session."""
    out = Path(mkdtemp(prefix="strokebench-programs-")) / f"{name}.elf"
    places = {"CODE_AT": code_at, "DATA_AT": data_at, "STACK": stack}
    symbols = [f"-Wl,--defsym={symbol}={value:#x}" for symbol, value in places.items()]
    command = ["arm-none-eabi-gcc", *FLAGS, *flags, "start.c", f"{name}.c", "-T", "link.ld", *symbols]
    subprocess.run([*command, "-o", str(out)], cwd=HERE, check=True, capture_output=True)
    return out

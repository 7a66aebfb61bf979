"""Builds the ELF images with Debian's arm-none-eabi-gcc; the same sources give the same bytes anywhere."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from targets.errors import FirmwareError
from targets.firmware import ELF, HERE

COMPILER = "arm-none-eabi-gcc"

FLAGS = (
    "-mcpu=cortex-m4",
    "-mthumb",
    "-mfloat-abi=hard",
    "-mfpu=fpv4-sp-d16",
    "-std=c99",
    "-O3",
    "-g",
    # Contraction to fused multiply-add would change the bits against the host and save 4 % of the time.
    "-ffp-contract=off",
    "-ffreestanding",
    # The loop inside memset must not become a call of memset.
    "-fno-tree-loop-distribute-patterns",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-nostdlib",
    "-Wl,--build-id=none",
)

SOURCES = (
    "core/calibration.c",
    "core/narx.c",
    "core/residual.c",
    "core/checks.c",
    "core/ifd.c",
    "core/ecu.c",
    "stm32f405/startup.c",
    "stm32f405/board.c",
    "stm32f405/main.c",
)


def build(role: str, out: Path) -> None:
    """Compile and link the image of `role` into the file `out`.

    Raises FirmwareError if there is no compiler or it refuses the sources.
    """
    compiler = shutil.which(COMPILER)
    if compiler is None:
        raise FirmwareError(f"no {COMPILER} on this machine: apt-get install gcc-arm-none-eabi")
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "image.elf"
        # Relative names, compiled in the sources' folder: no path of the machine enters the debug data.
        command = [compiler, *FLAGS, f"-ffile-prefix-map={HERE}=.", f"-DROLE=ROLE_{role.upper()}", *SOURCES]
        command += ["-T", "stm32f405/link.ld", "-lgcc", "-o", str(image)]
        result = subprocess.run(command, cwd=HERE, capture_output=True, text=True, check=False)
        if result.returncode:
            raise FirmwareError(f"{COMPILER}: {result.stderr.strip().splitlines()[0]}")
        shutil.copyfile(image, out)


if __name__ == "__main__":
    for name, path in ELF.items():
        build(name, path)

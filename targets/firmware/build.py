"""Builds the ELF images with Debian's arm-none-eabi-gcc; the same sources give the same bytes anywhere."""

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from targets.errors import FirmwareError
from targets.firmware import ELF, HERE, STEP_ELF
from targets.firmware.variants import FINAL, LIBRARY_FLAGS, STEPS, Variant

COMPILER = "arm-none-eabi-gcc"

COMMON_FLAGS = (
    "-std=c99",
    "-g",
    # Contraction to fused multiply-add would change the bits against the host and save 4 % of the time.
    "-ffp-contract=off",
    "-ffreestanding",
    # The loop inside memset must not become a call of memset.
    "-fno-tree-loop-distribute-patterns",
    "-Wall",
    "-Wextra",
    "-Werror",
)

LINK_FLAGS = ("-nostdlib", "-Wl,--build-id=none", "-T", "stm32f405/link.ld", "-lgcc")


def build(role: str, out: Path, variant: Variant = FINAL) -> None:
    """Compile and link the image of `role` into the file `out`.

    Raises FirmwareError if there is no compiler or it refuses the sources.
    """
    compiler = shutil.which(COMPILER)
    if compiler is None:
        raise FirmwareError(f"no {COMPILER} on this machine: apt-get install gcc-arm-none-eabi")
    # Relative names, compiled in the sources' folder: no path of the machine enters the debug data.
    common = [compiler, *variant.machine, *COMMON_FLAGS, f"-ffile-prefix-map={HERE}=."]
    with tempfile.TemporaryDirectory() as folder:
        objects = []
        for source in variant.library:
            objects.append(str(Path(folder) / f"{Path(source).stem}.o"))
            _run([*common, *LIBRARY_FLAGS, "-c", source, "-o", objects[-1]])
        image = Path(folder) / "image.elf"
        command = [*common, *variant.flags, f"-DROLE=ROLE_{role.upper()}", *variant.sources]
        _run([*command, *objects, *LINK_FLAGS, "-o", str(image)])
        shutil.copyfile(image, out)


def _run(command: Sequence[str]) -> None:
    result = subprocess.run(command, cwd=HERE, capture_output=True, text=True, check=False)
    if result.returncode:
        said = result.stderr.strip().splitlines()
        raise FirmwareError(f"{COMPILER}: {next((line for line in said if 'error: ' in line), said[0])}")


if __name__ == "__main__":
    for name, path in ELF.items():
        build(name, path)
    for name, path in STEP_ELF.items():
        if name != "final":
            build("ifd", path, STEPS[name])

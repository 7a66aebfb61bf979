"""The cycle model beside silicon: AES kernels with cycles published from an STM32F407.

python -m tests.benchmarks.silicon CHECKOUT      a checkout of github.com/jnk0le/cortexm-AES at b245d67
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from targets.mcu import image
from targets.mcu.call import Caller

KEY, TEXT, OUT = 0x20010000, 0x20011000, 0x20011100
SUITES = ("CM3_1T", "CM4_DSPsBOX")
HZ = 24_000_000
PUBLISHED = (
    # function, arguments, cycles at 0 and at 5 wait states (doc/aes/CM3_CM4_details.md)
    ("CM3_1T_AES128_keyschedule_enc", (KEY, TEXT), 302, 0),
    ("CM3_1T_AES256_keyschedule_enc", (KEY, TEXT), 378, 0),
    ("CM3_1T_AES_encrypt", (KEY, TEXT, OUT, 10), 626, 0),
    ("CM3_1T_AES_encrypt", (KEY, TEXT, OUT, 14), 858, 0),
    ("CM3_1T_AES128_encrypt_unrolled", (KEY, TEXT, OUT), 601, 715),
    ("CM3_1T_AES256_encrypt_unrolled", (KEY, TEXT, OUT), 821, 975),
    ("CM3_1T_AES_keyschedule_dec", (KEY, 10), 811, 0),
    ("CM3_1T_AES_keyschedule_dec", (KEY, 14), 1164, 0),
    ("CM3_1T_AES_decrypt", (KEY, TEXT, OUT, 10), 629, 0),
    ("CM3_1T_AES_decrypt", (KEY, TEXT, OUT, 14), 863, 0),
    ("CM3_1T_AES128_decrypt_unrolled", (KEY, TEXT, OUT), 602, 716),
    ("CM3_1T_AES256_decrypt_unrolled", (KEY, TEXT, OUT), 822, 978),
    ("CM4_DSPsBOX_AES_encrypt", (KEY, TEXT, OUT, 10), 844, 0),
    ("CM4_DSPsBOX_AES_encrypt", (KEY, TEXT, OUT, 14), 1172, 0),
    ("CM4_DSPsBOX_AES_decrypt", (KEY, TEXT, OUT, 10), 1240, 0),
    ("CM4_DSPsBOX_AES_decrypt", (KEY, TEXT, OUT, 14), 1744, 0),
)
LAYOUT = """SECTIONS {
  .text 0x08000000 : SUBALIGN(16) { *(.text*) *(.rodata*) }
  .data 0x20000000 : { *(.data*) *(.bss*) }
  /DISCARD/ : { *(.ARM.exidx*) }
}"""


def build(checkout: Path, folder: Path) -> Path:
    """A bare ELF of the kernels and their tables."""
    sources = [checkout / "aes" / "lookup_tables.c"]
    for suite in SUITES:
        sources += sorted((checkout / "aes" / "target" / suite).glob("*.S"))
    layout = folder / "layout.ld"
    layout.write_text(LAYOUT, encoding="ascii")
    elf = folder / "kernels.elf"
    flags = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-O2", "-nostdlib"]
    link = [f"-Wl,-T,{layout}", "-Wl,-e,0", "-Wl,--unresolved-symbols=ignore-all", "-o", str(elf)]
    subprocess.run(["arm-none-eabi-gcc", *flags, f"-I{checkout}", *map(str, sources), *link], check=True)
    return elf


def main() -> None:
    """Print published cycles, the model's with its bounds, and the difference."""
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    with tempfile.TemporaryDirectory() as name:
        kernels = image.load(build(Path(sys.argv[1]), Path(name)), vectors=None)
    print(f"{'function':32} rounds ws published  model  bounds        difference")
    errors = []
    for symbol, arguments, *published in PUBLISHED:
        for wait_states, cycles in zip((0, 5), published, strict=True):
            if not cycles:
                continue
            caller = Caller(kernels, HZ, wait_states)
            for _ in range(3 if wait_states else 1):  # the instruction cache as it is after a few
                found = caller.call(symbol, arguments)
            off = found.cycles - cycles
            errors.append(abs(off) / cycles)
            rounds = arguments[-1] if arguments[-1] < 15 else ""
            bounds = f"{found.optimistic}-{found.pessimistic}"
            print(
                f"{symbol:32} {rounds!s:6} {wait_states}  {cycles:8}  {found.cycles:6} {bounds:12} "
                f"{off:+4} ({100 * off / cycles:+.1f} %)"
            )
    mean = sum(errors) / len(errors)
    print(f"mean absolute difference {100 * mean:.2f} %, worst {100 * max(errors):.2f} %")


if __name__ == "__main__":
    main()

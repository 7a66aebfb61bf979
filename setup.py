"""Builds the host's copy of the ECU's numeric core where a C compiler is found; the rest: pyproject.toml."""

from setuptools import Extension, setup

CORE = "targets/firmware/core"

setup(
    ext_modules=[
        # Plain C behind ctypes: no Python headers needed. Without a compiler the emulated MCU serves instead.
        Extension(
            "targets.firmware._host",
            sources=[
                f"{CORE}/{name}.c" for name in ("calibration", "narx", "residual", "checks", "ifd", "ecu")
            ]
            + ["targets/firmware/host/host.c"],
            depends=[
                f"{CORE}/{n}.h" for n in ("calibration", "narx", "ifd", "ecu", "frames", "tansig", "dot")
            ],
            extra_compile_args=["-std=c99", "-O2", "-ffp-contract=off"],
            optional=True,
        )
    ]
)

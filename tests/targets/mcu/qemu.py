"""QEMU's STM32F405 (machine netduinoplus2) with a firmware in flash, driven through its debug stub."""

import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from tests.targets.mcu.rsp import Client

PROGRAM = "qemu-system-arm"
MACHINE = "netduinoplus2"
PATIENCE_S = 60
"""A QEMU that says nothing for so long has failed."""

COUNTING = ("-icount", "shift=0")
"""Every instruction is a nanosecond of QEMU's virtual time."""

_TIM2_CNT = 0x40000024


class Qemu(NamedTuple):
    """A running QEMU and the debugger's connection to it."""

    process: subprocess.Popen
    client: Client

    def instructions(self) -> int:
        """Instructions executed so far, with COUNTING: QEMU's TIM2 counts nanoseconds of its virtual time."""
        return int.from_bytes(self.client.read(_TIM2_CNT, 4), "little")


def installed() -> bool:
    """Whether there is a QEMU for ARM boards on this machine."""
    return shutil.which(PROGRAM) is not None


@contextmanager
def started(elf: Path, *options: str) -> Iterator[Qemu]:
    """QEMU with `elf`, halted in reset."""
    ours, its = socket.socketpair()
    ours.settimeout(PATIENCE_S)
    command = [PROGRAM, "-M", MACHINE, "-kernel", str(elf), "-S", "-display", "none", "-monitor", "none"]
    command += ["-serial", "none", "-chardev", f"socket,id=gdb,fd={its.fileno()}", "-gdb", "chardev:gdb"]
    with (
        ours,
        subprocess.Popen(
            [*command, *options],
            pass_fds=[its.fileno()],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process,
    ):
        its.close()

        def exchange(data: bytes) -> bytes:
            ours.sendall(data)
            return b"" if data == b"+" else ours.recv(0x10000)

        client = Client(exchange)
        # It answers for single registers only after it has described them.
        client.ask(b"qXfer:features:read:target.xml:0,ffb")
        try:
            yield Qemu(process, client)
        finally:
            process.kill()

"""What the doctor looks at on this machine. Each probe says what it found, '' where there is nothing.

Where a probe looks is an argument, so that any machine can be put before it.
"""

import os
import shutil
import socket
import time
from collections.abc import Callable, Collection, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

CAP_NET_ADMIN = 12
"""The capability (linux/capability.h) to add and set up network interfaces, and to pass their limits."""

FRAME_BYTES = 768
"""Of the kernel's memory that a classic frame takes in a socket's queue: 278 frames fill 212992 bytes."""

SLEEP_NS = 1_000_000
SLEEPS = 50
LATE_NS = 1_000_000
"""A sleep this much too long makes a frame of 1 kHz late by its period."""

_UP = 1  # IFF_UP


class LackError(Exception):
    """Something is there and not enough; the text says how much there is."""


def kernel_can(make: Callable[..., socket.socket] = socket.socket) -> str:
    """Whether the kernel has CAN sockets."""
    family = getattr(socket, "AF_CAN", None)
    if family is None:
        return ""
    try:
        make(family, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return ""
    return "CAN_RAW sockets"


def vcan_module(root: Path = Path("/"), release: str | None = None) -> str:
    """Whether the kernel has the driver of virtual interfaces, or can load it."""
    if (root / "sys/module/vcan").is_dir():
        return "loaded"
    folder = root / "lib/modules" / (os.uname().release if release is None else release)
    for name, found in (("modules.builtin", "built in"), ("modules.dep", "can be loaded")):
        try:
            text = (folder / name).read_text(encoding="utf-8", errors="replace")
        except OSError:
            continue
        if "/vcan.ko" in text:
            return found
    return ""


def interfaces(root: Path = Path("/")) -> str:
    """The CAN interfaces that are up, by name; LackError if all there are are down."""
    links = sorted((root / "sys/class/net").glob("*"))
    links = [link for link in links if link.name.startswith(("vcan", "can", "vxcan", "slcan"))]
    up = [link.name for link in links if _number(link / "flags", 16) & _UP]
    if links and not up:
        raise LackError(f"{', '.join(link.name for link in links)} down: ip link set up {links[0].name}")
    return ", ".join(up)


def rights(root: Path = Path("/")) -> str:
    """Whether this process may create interfaces."""
    return "CAP_NET_ADMIN" if _may_administer(root) else ""


def receive_buffer(wanted: int, root: Path = Path("/")) -> str:
    """The frames that the queue of `wanted` bytes the bench asks for holds; LackError if it gets less."""
    most = _number(root / "proc/sys/net/core/rmem_max")
    if most < wanted and not _may_administer(root):
        raise LackError(f"rmem_max is {most}: {frames_held(2 * most)} frames")
    usual = _number(root / "proc/sys/net/core/rmem_default")
    # The kernel doubles what is asked for, and takes frames until that is reached.
    return f"{frames_held(2 * wanted)} frames ({frames_held(usual)} in a queue of the default size)"


def frames_held(queue_bytes: int) -> int:
    """Classic frames that a queue of so many bytes takes before it drops one."""
    return -(-queue_bytes // FRAME_BYTES)


def clock(
    now: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], None] = time.sleep,
    resolution_s: float | None = None,
) -> str:
    """The clock's resolution and by how much a sleep of 1 ms is too long; LackError from 1 ms on (p99)."""
    if resolution_s is None:
        resolution_s = time.get_clock_info("monotonic").resolution
    over_ns = []
    for _ in range(SLEEPS):
        begun = now()
        sleep(SLEEP_NS / 1e9)
        over_ns.append(now() - begun - SLEEP_NS)
    p99 = sorted(over_ns)[-(-99 * SLEEPS // 100) - 1]
    found = f"resolution {resolution_s * 1e9:g} ns; a sleep of 1 ms is {p99 / 1e6:.3f} ms too long (p99)"
    if p99 >= LATE_NS:
        raise LackError(found)
    return found


def gpu(root: Path = Path("/"), load: Callable[[], Any] | None = None) -> str:
    """The GPU that training can use, LackError if torch cannot; it is loaded only where there is one."""
    if not any((root / "dev").glob("nvidia[0-9]*")):
        return ""
    if load is None:
        if find_spec("torch") is None:
            raise LackError("a GPU is there, torch is not")

        def load() -> Any:
            import torch

            return torch

    cuda = load().cuda
    if not cuda.is_available():
        raise LackError("a GPU is there, this torch cannot use it")
    return str(cuda.get_device_name(0))


def can_interfaces(known: Collection[str] | None = None) -> str:
    """The python-can interfaces a bus can be named with."""
    if known is None:
        import can

        known = can.VALID_INTERFACES
    return ", ".join(sorted(known))


def tool(*names: str, which: Callable[[str], str | None] = shutil.which) -> str:
    """Where the first of these programs lies."""
    return next((path for name in names if (path := which(name))), "")


def _may_administer(root: Path) -> bool:
    return bool(int(_status(root).get("CapEff", "0"), 16) >> CAP_NET_ADMIN & 1)


def _status(root: Path) -> Mapping[str, str]:
    try:
        lines = (root / "proc/self/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return {}
    return {name: value.strip() for name, _, value in (line.partition(":") for line in lines)}


def _number(path: Path, base: int = 10) -> int:
    """The number in a file of the kernel's; 0 if there is none."""
    try:
        return int(path.read_text(encoding="ascii"), base)
    except (OSError, ValueError):
        return 0

"""The ECU on the host: the firmware's own C core, compiled for this machine. Same frames, no cycle times."""

import ctypes
from collections import deque
from functools import cache
from importlib.machinery import EXTENSION_SUFFIXES

from targets.calibration import ROOM, Calibration
from targets.ecu import Frame, Transmission
from targets.errors import FirmwareError
from targets.firmware import HERE

ROLES = ("ifd", "soft_sensor")


class _CanFrame(ctypes.Structure):
    _fields_ = (("id", ctypes.c_uint32), ("length", ctypes.c_uint32), ("data", ctypes.c_uint8 * 8))


@cache
def library() -> ctypes.CDLL | None:
    """The compiled core, None where it was not built (no C compiler at installation)."""
    for suffix in EXTENSION_SUFFIXES:
        path = HERE / f"_host{suffix}"
        if path.exists():
            return ctypes.CDLL(str(path))
    return None


class HostEcu:
    """The numeric core of role `ifd` or `soft_sensor` with `calibration`; it answers at once.

    Raises FirmwareError if the core was not built or refuses the calibration.
    """

    def __init__(self, calibration: Calibration, role: str = "ifd") -> None:
        core = library()
        if core is None:
            raise FirmwareError("the host core is not built: install a C compiler and strokebench again")
        self.name = role
        self._core = core
        self._image = ctypes.create_string_buffer(calibration.image(), ROOM)
        self._ecu = ctypes.create_string_buffer(core.host_ecu_size())
        self._out = _CanFrame()
        self._queue: deque[Transmission] = deque()
        self._handle = 0
        fault = core.ecu_init(self._ecu, self._image, ROOM, ROLES.index(role))
        if fault:
            raise FirmwareError(f"the host core refuses the calibration (fault {fault})")

    def advance(self, t_ns: int) -> Transmission | None:
        """The next frame that was requested at or before `t_ns`."""
        return self._queue.popleft() if self._queue and self._queue[0].t_ns <= t_ns else None

    def receive(self, frame: Frame, t_ns: int) -> None:
        """Take in a frame; a completed input cycle is answered at the same instant."""
        if frame.extended:
            return  # another identifier than the standard one of the same number
        data = (ctypes.c_uint8 * 8)(*frame.data)
        received = _CanFrame(frame.id, len(frame.data), data)
        if self._core.ecu_receive(self._ecu, ctypes.byref(received)):
            self._core.ecu_step(self._ecu)
            self._core.ecu_status(self._ecu, ctypes.byref(self._out))
            self._post(t_ns)
            self._core.ecu_timing(self._ecu, 0, ctypes.byref(self._out))
            self._post(t_ns)

    def sent(self, handle: int, t_ns: int) -> None:
        """Nothing waits for a mailbox here."""

    def where(self) -> str:
        """The host core has no program counter."""
        return ""

    def _post(self, t_ns: int) -> None:
        out = self._out
        self._handle += 1
        frame = Frame(out.id, bytes(out.data[: out.length]))
        self._queue.append(Transmission(t_ns, self._handle, frame))

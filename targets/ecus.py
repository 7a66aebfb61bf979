"""The project's own ECUs by name, and where they run: the emulated MCU or the host.

Belongs here: putting image, calibration and host together. Never: what they do.
"""

from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

from targets.calibration import Calibration, load
from targets.ecu import Ecu
from targets.errors import TargetError
from targets.firmware import ELF
from targets.mcu.image import Image
from targets.mcu.image import load as load_image

ROLES = tuple(ELF)
HOSTS = ("mcu", "host")
CALIBRATIONS = Path(__file__).parent / "calibrations"
DEFAULT_NAME = "gsxr1000"
DEFAULT_CALIBRATION = CALIBRATIONS / f"{DEFAULT_NAME}.json"


@dataclass(frozen=True)
class Build:
    """An ECU ready to be switched on: role, where it runs, firmware image and calibration.

    clock_hz: the emulated CPU's clock, in place of the image's. Raises TargetError for a role or host that
    does not exist.
    """

    role: str
    host: str
    calibration: Calibration
    image: Image
    clock_hz: int | None = None

    def power_on(self, bitrate: int = 500_000) -> Ecu:
        """A fresh ECU of this build, out of reset, on a bus of `bitrate` bit/s."""
        if self.host == "host":
            from targets.host import HostEcu

            return HostEcu(self.calibration, self.role)
        from targets.emulated import EmulatedEcu

        return EmulatedEcu(self.image, self.calibration, self.role, bitrate=bitrate, clock_hz=self.clock_hz)

    def needs(self) -> tuple[str, ...]:
        """The lap channels without which this ECU cannot answer."""
        inputs = self.calibration.network.inputs
        return (*inputs, "rear_stroke_mm") if self.role == "ifd" else inputs

    def provenance(self) -> dict[str, str]:
        """What identifies this build: SHA-256 of firmware file and calibration image, clock if it was set."""
        clock = {} if self.clock_hz is None else {"clock_hz": str(self.clock_hz)}
        return {
            "ecu": self.role,
            "runs_on": self.host,
            "firmware_sha256": self.image.digest,
            "calibration_sha256": sha256(self.calibration.image()).hexdigest(),
            **clock,
        }


def build(
    role: str = "ifd",
    host: str = "mcu",
    calibration: Path | None = None,
    elf: Path | None = None,
    clock_hz: int | None = None,
) -> Build:
    """Load the parts of an ECU; the shipped calibration and image where none is named, the image's clock."""
    if role not in ROLES:
        raise TargetError(f"no ECU {role}; there are {', '.join(ROLES)}")
    if host not in HOSTS:
        raise TargetError(f"no place {host} to run an ECU; there are {', '.join(HOSTS)}")
    if elf and host == "host":
        raise TargetError(f"{elf}: the host runs its own core, no image; leave out --elf or choose --on mcu")
    if clock_hz and host == "host":
        raise TargetError(f"clock {clock_hz / 1e6:g} MHz: the host has no clock to set; choose --on mcu")
    return Build(role, host, load(calibration or DEFAULT_CALIBRATION), _image(elf or ELF[role]), clock_hz)


def calibration_of(name: str) -> Calibration:
    """The shipped calibration of that name, or that in the file; CalibrationError if it cannot be read."""
    shipped = CALIBRATIONS / f"{name}.json"
    return load(shipped if "/" not in name and shipped.exists() else Path(name))


@cache
def _image(path: Path) -> Image:
    return load_image(path)

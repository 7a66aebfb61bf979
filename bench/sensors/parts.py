"""What can be wrong with a sensor, as numbers: one record for each kind of part.

Belongs here: the figures, their units, and that every default is the ideal part. Never: a data sheet's value
(`datasheets.toml` has those), how a figure acts (`potentiometer`, `mems`, `encoder`), a file.

"Limit" is a bound which no specimen leaves; "sigma" the standard deviation over specimens and laps.
FIDELITY: each lap is ridden with specimens of its own; the sensors of one motorcycle do not stay the same.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from hashlib import sha256

from bench.sensors.transducers import Transducer


@dataclass(frozen=True)
class Potentiometer:
    """A slider on a resistive track, read against its own supply, and the low-pass behind it."""

    linearity: float = 0.0  # limit of the smooth deviation from the line, of the stroke
    smoothness: float = 0.0  # the track's texture, peak to peak, of the stroke
    grain_mm: float = 0.1  # how far apart two places of the track differ in texture
    hysteresis_mm: float = 0.0  # between the same place reached from either side
    lowpass_hz: float = 0.0  # -3 dB; 0 for none
    lowpass_order: int = 2


@dataclass(frozen=True)
class Mems:
    """A sensor with a digital output. Quantities that are not of the full scale are in units of `unit`."""

    unit: float = 1.0  # one unit of this record in the unit of the channel
    noise_density: float = 0.0  # per sqrt(Hz), one-sided, white up to the low-pass
    lowpass_hz: float = 0.0  # -3 dB; 0 for none
    lowpass_order: int = 2
    odr_hz: float = 0.0  # rate at which the output register is renewed; 0: at every sample
    zero_level: float = 0.0  # sigma of the zero level at the lap's start, after calibration
    zero_per_k: float = 0.0  # sigma of its change with temperature
    warming_k: float = 0.0  # temperature rise of a long lap ...
    warming_s: float = 300.0  # ... and the time constant at which it comes
    zero_walk: float = 0.0  # random walk of the zero level, per sqrt(s)
    sensitivity: float = 0.0  # sigma of the relative error of the slope
    nonlinearity: float = 0.0  # limit of the smooth deviation from the line, of the full scale


@dataclass(frozen=True)
class Encoder:
    """A pulse for each tooth of a ring, and the timer that measures the time between two."""

    teeth: int
    circumference_m: float  # of the tyre: the way of one revolution
    edge_error: float = 0.0  # sigma of a tooth's place, of the pitch
    runout: float = 0.0  # amplitude of the once-a-revolution error of the teeth's places, of the pitch
    circumference: float = (
        0.0  # sigma of the relative error of the circumference that the logger reckons with
    )
    tick_s: float = 1e-6  # the timer's resolution
    timeout_s: float = 0.5  # without a pulse for so long the wheel counts as standing


@dataclass(frozen=True)
class Logger:
    """The data logger's analog to digital converter and its reference; LSB is one code."""

    noise_lsb: float = 0.0  # rms, a new value for each conversion
    inl_lsb: float = 0.0  # limit of the integral non-linearity
    supply_tolerance: float = 0.0  # limit of the sensors' supply, relative
    supply_ripple: float = 0.0  # amplitude on the supply, relative
    ripple_hz: float = 100.0
    reference_follows: float = 1.0  # share of the supply's deviation the reference has too: 1 is ratiometric
    reference_mismatch: float = 0.0  # sigma of the relative error between reference and supply


Part = Potentiometer | Mems | Encoder


@dataclass(frozen=True)
class Sensors:
    """The sensors of a motorcycle: model as in `transducers` -> its figures. A model that lacks is ideal."""

    name: str = "ideal"
    parts: Mapping[str, Part] = field(default_factory=dict)
    logger: Logger | None = None

    def touch(self, transducer: Transducer) -> bool:
        """Whether anything of this acts on what `transducer` says."""
        return transducer.model in self.parts or (transducer.ratiometric and self.logger is not None)

    def digest(self) -> str:
        """SHA-256 of all figures: two sets of sensors with the same one give the same codes."""
        rows = sorted((model, sorted(asdict(part).items())) for model, part in self.parts.items())
        logger = sorted(asdict(self.logger).items()) if self.logger else None
        return sha256(repr((rows, logger)).encode()).hexdigest()


IDEAL = Sensors()
"""Every code is the rounded true value."""

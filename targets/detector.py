"""The detectors' settings, as a calibration carries them: the thesis's residual, and the second one's checks.

Belongs here: what can be set, and within which bounds. Never: what a detector does with it.
"""

from dataclasses import dataclass, fields
from typing import Any, ClassVar

from targets.errors import CalibrationError

FEEDBACKS = ("predicted", "measured")

Bounds = dict[str, tuple[float, float]]


def _check(detector: Any) -> None:
    for name, (low, high) in detector.BOUNDS.items():
        value = getattr(detector, name)
        if not low <= value <= high:
            raise CalibrationError(f"{name} is {value}, the ECU takes {low} to {high}")
    if detector.feedback not in FEEDBACKS:
        raise CalibrationError(f"feedback {detector.feedback!r} is neither predicted nor measured")


@dataclass(frozen=True)
class Detector:
    """Residual generator (V.1) and decision maker (Figure V.8).

    threshold: T, relative. window: L_s, samples. multiple: n. feedback: what the network is fed back with.
    warmup: steps before the residual is trusted. floor_mm: smallest divisor of the residual, mm.
    Raises CalibrationError for what the firmware does not take.
    """

    threshold: float = 0.10
    window: int = 20
    multiple: int = 5
    feedback: str = "predicted"
    warmup: int = 200
    floor_mm: float = 0.1

    TYPE: ClassVar[str] = "residual"
    BOUNDS: ClassVar[Bounds] = {
        "window": (1, 128),
        "multiple": (1, 10_000),
        "warmup": (0, 1_000_000),
        "threshold": (0.0, 1e6),
        "floor_mm": (1e-6, 1e3),
    }

    def __post_init__(self) -> None:
        _check(self)


@dataclass(frozen=True)
class Checks:
    """The second detector: one check for each kind of fault (`firmware/core/checks.c`).

    Windows and steps in samples at 100 Hz. rail_*: measured beyond rail_low_mm or rail_high_mm for rail_steps
    on end, while the prediction is rail_gap_mm off it: short, open. repeat_*: the same value for repeat_steps
    more samples, while the prediction moves by repeat_motion_mm: hold. hold_ratio: measured to predicted
    standard deviation over hold_window, where the predicted one is still_mm at least: hold. loss_threshold:
    the signed mean over loss_window of log(measured / predicted), strokes below loss_floor_mm counting as
    that: uncalibration, of gain or offset. heal_steps: without a finding before the alarm is taken back.
    Raises CalibrationError for what the firmware does not take.
    """

    feedback: str = "predicted"
    warmup: int = 200
    rail_steps: int = 3
    repeat_steps: int = 10
    hold_window: int = 50
    loss_window: int = 200
    heal_steps: int = 100
    rail_low_mm: float = 0.0134
    rail_high_mm: float = 109.98
    rail_gap_mm: float = 10.0
    repeat_motion_mm: float = 1.0
    hold_ratio: float = 0.2
    still_mm: float = 1.0
    loss_threshold: float = 0.07
    loss_floor_mm: float = 5.0

    TYPE: ClassVar[str] = "checks"
    BOUNDS: ClassVar[Bounds] = {
        "warmup": (0, 1_000_000),
        "rail_steps": (1, 10_000),
        "repeat_steps": (1, 10_000),
        "hold_window": (2, 128),
        "loss_window": (1, 512),
        "heal_steps": (1, 10_000),
        "rail_low_mm": (-1e3, 1e3),
        "rail_high_mm": (-1e3, 1e3),
        "rail_gap_mm": (0.0, 1e3),
        "repeat_motion_mm": (0.0, 1e3),
        "hold_ratio": (0.0, 1.0),
        "still_mm": (0.0, 1e2),
        "loss_threshold": (0.0, 1.0),
        "loss_floor_mm": (1e-3, 1e3),
    }

    def __post_init__(self) -> None:
        _check(self)


AnyDetector = Detector | Checks
DETECTORS: dict[str, type[Detector] | type[Checks]] = {kind.TYPE: kind for kind in (Detector, Checks)}


def document(detector: AnyDetector) -> dict[str, Any]:
    """The settings as plain data; `read` gives back an equal detector."""
    return {"type": detector.TYPE} | {f.name: getattr(detector, f.name) for f in fields(detector)}


def read(table: dict[str, Any]) -> AnyDetector:
    """A detector from plain data. Raises CalibrationError naming the entry at fault."""
    kind = DETECTORS.get(str(table.get("type")))
    if kind is None:
        raise CalibrationError(f"detector type {table.get('type')!r} is none of {', '.join(DETECTORS)}")
    values: dict[str, Any] = {}
    for field in fields(kind):
        value = table.get(field.name)
        wanted = field.type if isinstance(field.type, str) else field.type.__name__
        number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 3e38
        if wanted == "str" and not isinstance(value, str):
            raise CalibrationError(f"{field.name} is {value!r}, not a word")
        if wanted == "int" and not (number and isinstance(value, int)):
            raise CalibrationError(f"{field.name} is {value!r}, not an integer")
        if wanted == "float" and not number:
            raise CalibrationError(f"{field.name} is {value!r}, not a finite number")
        values[field.name] = float(value or 0.0) if wanted == "float" else value
    return kind(**values)

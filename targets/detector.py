"""The detectors' settings, as a calibration carries them: the thesis's residual, and the second one's checks.

Belongs here: what can be set, and within which bounds. Never: what a detector does with it.
"""

from dataclasses import MISSING, dataclass, field, fields
from typing import Any, ClassVar, TypeGuard

from targets.errors import CalibrationError

FEEDBACKS = ("predicted", "measured")


def is_number(value: object) -> TypeGuard[int | float]:
    """A number that single precision can hold; NaN is not, nor is an integer too long for any float."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 3e38


def within(low: float, high: float, default: Any = MISSING) -> Any:
    """A setting with what can be taken of it."""
    return field(default=default, metadata={"bounds": (low, high)})


def check(settings: Any, who: str = "the ECU") -> None:
    """Raise CalibrationError for a setting of the wrong kind, or not within what `who` takes."""
    for setting in fields(settings):
        value = getattr(settings, setting.name)
        if setting.type is str and not isinstance(value, str):
            raise CalibrationError(f"{setting.name} is {value!r}, not a word")
        if setting.type is int and not (is_number(value) and isinstance(value, int)):
            raise CalibrationError(f"{setting.name} is {value!r}, not an integer")
        if setting.type is float:
            if not is_number(value):
                raise CalibrationError(f"{setting.name} is {value!r}, not a finite number")
            object.__setattr__(settings, setting.name, float(value))
    for setting in fields(settings):
        value, bounds = getattr(settings, setting.name), setting.metadata.get("bounds")
        if bounds and not bounds[0] <= value <= bounds[1]:
            raise CalibrationError(f"{setting.name} is {value}, {who} takes {bounds[0]} to {bounds[1]}")


def _check(detector: "AnyDetector") -> None:
    check(detector)
    if detector.feedback not in FEEDBACKS:
        raise CalibrationError(f"feedback {detector.feedback!r} is neither predicted nor measured")


@dataclass(frozen=True)
class Detector:
    """Residual generator (V.1) and decision maker (Figure V.8).

    threshold: T, relative. window: L_s, samples. multiple: n. feedback: what the network is fed back with.
    warmup: steps before the residual is trusted. floor_mm: smallest divisor of the residual, mm.
    Raises CalibrationError for what the firmware does not take.
    """

    threshold: float = within(0.0, 1e6, 0.10)
    window: int = within(1, 128, 20)
    multiple: int = within(1, 10_000, 5)
    feedback: str = "predicted"
    warmup: int = within(0, 1_000_000, 200)
    floor_mm: float = within(1e-6, 1e3, 0.1)

    TYPE: ClassVar[str] = "residual"

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
    warmup: int = within(0, 1_000_000, 200)
    rail_steps: int = within(1, 10_000, 3)
    repeat_steps: int = within(1, 10_000, 10)
    hold_window: int = within(2, 128, 50)
    loss_window: int = within(1, 512, 200)
    heal_steps: int = within(1, 10_000, 100)
    rail_low_mm: float = within(-1e3, 1e3, 0.0134)
    rail_high_mm: float = within(-1e3, 1e3, 109.98)
    rail_gap_mm: float = within(0.0, 1e3, 10.0)
    repeat_motion_mm: float = within(0.0, 1e3, 1.0)
    hold_ratio: float = within(0.0, 1.0, 0.2)
    still_mm: float = within(0.0, 1e2, 1.0)
    loss_threshold: float = within(0.0, 1.0, 0.07)
    loss_floor_mm: float = within(1e-3, 1e3, 5.0)

    TYPE: ClassVar[str] = "checks"

    def __post_init__(self) -> None:
        _check(self)


AnyDetector = Detector | Checks
DETECTORS: dict[str, type[Detector] | type[Checks]] = {kind.TYPE: kind for kind in (Detector, Checks)}


def document(detector: AnyDetector) -> dict[str, Any]:
    """The settings as plain data; `read` gives back an equal detector."""
    return {"type": detector.TYPE} | {one.name: getattr(detector, one.name) for one in fields(detector)}


def read(table: dict[str, Any]) -> AnyDetector:
    """A detector from plain data. Raises CalibrationError naming the entry at fault."""
    kind = DETECTORS.get(str(table.get("type")))
    if kind is None:
        raise CalibrationError(f"detector type {table.get('type')!r} is none of {', '.join(DETECTORS)}")
    values: dict[str, Any] = {setting.name: table.get(setting.name) for setting in fields(kind)}
    return kind(**values)

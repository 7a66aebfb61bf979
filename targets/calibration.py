"""Calibration data: the one file that `bench run`, the firmware and the host core all take.

A calibration is JSON on disk (numbers and text only: nothing in it is ever executed) and a flat little-endian
image in flash, laid out as `firmware/core/calibration.h` says. Weights are stored as the single-precision
numbers the ECU computes with; their decimal text gives them back exactly.
"""

import json
import struct
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dbc import CHANNELS
from targets.detector import DETECTORS, AnyDetector, Checks, Detector, is_number
from targets.detector import document as detector_document
from targets.detector import read as read_detector
from targets.errors import CalibrationError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from targets.narx.network import Narx

FORMAT = "strokebench-calibration"
VERSION = 2
MAGIC = 0x4C414353
ROOM = 16 * 1024
"""Bytes of the flash sector that holds the image."""

MAX_NEURONS, MAX_DELAYS, MAX_INPUTS, MAX_SHIFT = 32, 16, 7, 15
MAX_WEIGHT = 1e9
"""Larger ones could overflow single precision, and a prediction that is no number never raises an alarm."""

_HEAD = struct.Struct("<12I6f")
_CHECKS = struct.Struct("<6I8f")
_INPUT = struct.Struct("<Iff")
_PREFIX = struct.Struct("<4I")


@dataclass(frozen=True)
class Calibration:
    """A network, a detector, and where they came from.

    baselines: settings of detectors that no ECU runs, for comparison: name -> setting -> number.
    Raises CalibrationError if the parts do not fit together or the image would not fit its flash sector.
    """

    network: "Narx"
    detector: AnyDetector = field(default_factory=Detector)
    provenance: dict[str, Any] = field(default_factory=dict, compare=False)
    baselines: dict[str, dict[str, float]] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        import numpy as np

        n, d = self.network.neurons, self.network.delays
        _bound("neurons", n, 1, MAX_NEURONS)
        _bound("delays", d, 1, MAX_DELAYS)
        _bound("inputs", len(self.network.inputs), 1, MAX_INPUTS)
        _bound("shift", self.network.shift, 0, MAX_SHIFT)
        for name in self.network.inputs:
            if name not in CHANNELS:
                raise CalibrationError(f"unknown input {name!r}; the ECU knows {', '.join(CHANNELS)}")
        # Wider than any sensor, and far from what single precision could not hold.
        for name, (low, high) in zip(
            (*self.network.inputs, self.network.output),
            (*self.network.input_ranges, self.network.output_range),
            strict=True,
        ):
            _bound(f"range of {name!r}: low end", low, -1e6, 1e6)
            _bound(f"range of {name!r}: high end", high, -1e6, 1e6)
            _bound(f"range of {name!r}: width", high - low, 1e-6, 2e6)
        _bound("initial_mm", self.network.initial_mm, -1e6, 1e6)
        for name in ("W1", "b1", "w2", "b2"):
            _bound(f"largest of {name}", float(np.max(np.abs(getattr(self.network, name)))), 0, MAX_WEIGHT)
        if self.detector.feedback == "measured" and self.network.shift:
            raise CalibrationError(
                f"feedback measured with shift {self.network.shift}: the stroke {self.network.shift} samples "
                "ahead cannot have been measured"
            )
        size = len(self.image())
        if size > ROOM:
            raise CalibrationError(f"image of {size} bytes exceeds its flash sector of {ROOM}")

    def image(self) -> bytes:
        """The bytes in flash, checksum included."""
        import numpy as np

        net = self.network
        chosen = self.detector
        det = chosen if isinstance(chosen, Detector) else Detector()
        checks = chosen if isinstance(chosen, Checks) else Checks()
        n, n_x = net.W1.shape
        stride = (n_x + 3) & ~3
        rows = np.zeros((n, stride + 1), dtype="<f4")
        rows[:, 0] = net.b1
        rows[:, 1 : n_x + 1] = net.W1
        weights = rows.tobytes() + np.asarray(net.w2, dtype="<f4").tobytes()
        lo, hi = net.output_range
        offset, scale = (hi + lo) / 2, 2 / (hi - lo)
        inputs = b"".join(
            _INPUT.pack(CHANNELS.index(name), (b + a) / 2, 2 / (b - a))
            for name, (a, b) in zip(net.inputs, net.input_ranges, strict=True)
        ).ljust(MAX_INPUTS * _INPUT.size, b"\0")
        size = _HEAD.size + _CHECKS.size + len(inputs) + 4 + len(weights)
        head = _HEAD.pack(
            MAGIC,
            VERSION,
            size,
            0,
            n,
            net.delays,
            len(net.inputs),
            int(chosen.feedback == "measured"),
            net.shift,
            det.window,
            det.multiple,
            chosen.warmup,
            det.threshold,
            det.floor_mm,
            net.initial_mm,
            1 / scale,
            offset,
            scale,
        )
        second = _CHECKS.pack(
            list(DETECTORS).index(chosen.TYPE),
            checks.rail_steps,
            checks.repeat_steps,
            checks.hold_window,
            checks.loss_window,
            checks.heal_steps,
            checks.rail_low_mm,
            checks.rail_high_mm,
            checks.rail_gap_mm,
            checks.repeat_motion_mm,
            checks.hold_ratio,
            checks.still_mm,
            checks.loss_threshold,
            checks.loss_floor_mm,
        )
        body = head[_PREFIX.size :] + second + inputs + struct.pack("<f", net.b2) + weights
        return _PREFIX.pack(MAGIC, VERSION, size, zlib.crc32(body)) + body

    @property
    def checksum(self) -> str:
        """CRC-32 of the image's content, as eight hexadecimal digits."""
        return f"{_PREFIX.unpack_from(self.image())[3]:08x}"

    def with_detector(self, **changes: Any) -> "Calibration":
        """The same network and detector with other settings of it."""
        return replace(self, detector=replace(self.detector, **changes))


def dumps(calibration: Calibration) -> str:
    """The calibration as JSON text; `loads` gives back an equal one."""
    net = calibration.network
    document = {
        "format": FORMAT,
        "version": VERSION,
        "checksum": calibration.checksum,
        "network": {
            "inputs": [
                {"channel": name, "range": list(span)}
                for name, span in zip(net.inputs, net.input_ranges, strict=True)
            ],
            "output": {"channel": net.output, "range": list(net.output_range)},
            "delays": net.delays,
            "shift": net.shift,
            "initial_mm": _short(net.initial_mm),
            "hidden_weights": [_floats(row) for row in net.W1],
            "hidden_biases": _floats(net.b1),
            "output_weights": _floats(net.w2),
            "output_bias": _short(net.b2),
        },
        "detector": detector_document(calibration.detector),
        **({"baselines": calibration.baselines} if calibration.baselines else {}),
        "provenance": calibration.provenance,
    }
    return json.dumps(document, indent=1) + "\n"


def loads(text: str | bytes, source: str = "calibration") -> Calibration:
    """A calibration from JSON text. Raises CalibrationError, naming `source`, for anything it cannot be."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f"{source}: not JSON ({error})") from None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise CalibrationError(f"{source}: not a {FORMAT} file")
    version = document.get("version")
    if isinstance(version, bool) or version != VERSION:
        raise CalibrationError(f"{source}: version {version!r}, this strokebench reads version {VERSION}")
    try:
        calibration = _build(document)
    except CalibrationError as error:
        raise CalibrationError(f"{source}: {error}") from None
    except RecursionError:  # what could be read cannot be shown from deeper down
        raise CalibrationError(f"{source}: not JSON (nested too deep)") from None
    if document.get("checksum") != calibration.checksum:
        raise CalibrationError(
            f"{source}: checksum {document.get('checksum')!r} does not match the content "
            f"({calibration.checksum})"
        )
    return calibration


def load(path: Path) -> Calibration:
    """Read a calibration file; CalibrationError for a file that is absent, unreadable or not one."""
    try:
        text = path.read_bytes()
    except OSError as error:
        raise CalibrationError(f"{path}: {(error.strerror or str(error)).lower()}") from None
    return loads(text, source=str(path))


def _build(document: dict[str, Any]) -> Calibration:
    import numpy as np

    from targets.narx.network import Narx

    net = _get(document, "network", dict)
    inputs = _get(net, "inputs", list)
    names, spans = [], []
    for entry in inputs:
        if not isinstance(entry, dict):
            raise CalibrationError(f"network input {entry!r} is not a table of channel and range")
        names.append(_get(entry, "channel", str))
        spans.append(_span(entry))
    output = _get(net, "output", dict)
    delays = _integer(net, "delays")
    biases = _vector(_get(net, "hidden_biases", list), "hidden_biases")
    n = len(biases)
    _bound("neurons", n, 1, MAX_NEURONS)
    _bound("delays", delays, 1, MAX_DELAYS)
    rows = _get(net, "hidden_weights", list)
    n_x = (len(names) + 1) * delays
    if len(rows) != n:
        raise CalibrationError(f"hidden_weights has {len(rows)} rows for {n} neurons")
    for k, row in enumerate(rows):
        if not isinstance(row, list) or len(row) != n_x:
            found = len(row) if isinstance(row, list) else repr(row)
            raise CalibrationError(
                f"hidden_weights row {k} has {found} weights; {len(names)} inputs and the fed-back stroke "
                f"with {delays} delays need {n_x}"
            )
    outputs = _vector(_get(net, "output_weights", list), "output_weights")
    if len(outputs) != n:
        raise CalibrationError(f"output_weights has {len(outputs)} weights for {n} neurons")
    network = Narx(
        inputs=tuple(names),
        output=_get(output, "channel", str),
        delays=delays,
        shift=_integer(net, "shift"),
        input_ranges=tuple(spans),
        output_range=_span(output),
        W1=np.stack([_vector(row, "hidden_weights") for row in rows]),
        b1=biases,
        w2=outputs,
        b2=_number(net, "output_bias"),
        initial_mm=_number(net, "initial_mm"),
    )
    detector = read_detector(_get(document, "detector", dict))
    provenance = document.get("provenance", {})
    return Calibration(
        network, detector, provenance if isinstance(provenance, dict) else {}, _baselines(document)
    )


def _baselines(document: dict[str, Any]) -> dict[str, dict[str, float]]:
    found = document.get("baselines", {})
    if not isinstance(found, dict) or not all(isinstance(table, dict) for table in found.values()):
        raise CalibrationError("baselines is not a table of tables")
    return found


def _get(table: dict[str, Any], key: str, kind: type) -> Any:
    value = table.get(key)
    if not isinstance(value, kind):
        raise CalibrationError(f"{key} is missing or not a {kind.__name__}")
    return value


def _number(table: dict[str, Any], key: str) -> float:
    value = table.get(key)
    if not is_number(value):
        raise CalibrationError(f"{key} is {value!r}, not a finite number")
    return float(value)


def _integer(table: dict[str, Any], key: str) -> int:
    value = table.get(key)
    if isinstance(value, bool) or not isinstance(value, int):
        raise CalibrationError(f"{key} is {value!r}, not an integer")
    return value


def _span(entry: dict[str, Any]) -> tuple[float, float]:
    span = entry.get("range")
    if not isinstance(span, list) or len(span) != 2:
        raise CalibrationError(f"range is {span!r}, not [low, high]")
    low, high = _vector(span, "range").tolist()
    if not low < high:
        raise CalibrationError(f"range {span} is empty")
    return low, high


def _vector(values: list[Any], key: str) -> "NDArray[np.float64]":
    import numpy as np

    for value in values:
        if not is_number(value):
            raise CalibrationError(f"{key} holds {value!r}, not a finite number")
    return np.array(values, dtype=np.float64)


def _bound(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise CalibrationError(f"{name} is {value}, the ECU takes {low} to {high}")


def _short(value: float) -> float:
    """The shortest decimal that gives back the nearest single-precision number."""
    import numpy as np

    return float(str(np.float32(value)))


def _floats(values: "NDArray[np.float64]") -> list[float]:
    return [_short(value) for value in values]

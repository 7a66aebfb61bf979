"""One ECU, two places to run it: what either promises, that both send the same bytes, and the right ones.

The independent reference is the network in float64 (`Narx`), the residual and the decision written down in
numpy from equation (V.1) and Figure V.8.
"""

from dataclasses import replace

import numpy as np
import pytest

from bench.codec import Codec
from bench.faults.insertion import insert
from bench.faults.spec import parse_fault
from bench.mdlog.logger import sampled, schedule
from bench.rig import ride
from bench.sensors.codes import acquire
from bench.watch import STATUS, Watch
from targets.calibration import Calibration, Detector
from targets.ecu import Frame
from targets.ecus import ROLES
from targets.emulated import EmulatedEcu
from targets.firmware import ELF
from targets.host import HostEcu, library
from targets.mcu.image import load
from tests.conftest import network, wavy_lap

MS = 1_000_000
CODEC = Codec()

TOLERANCE_MM = 0.001 + 0.001
"""Half a step of the status frame's 0.002 mm, and as much again for single precision over a whole lap."""

RESIDUAL_PCT = 0.005 + 0.015
"""Half a step of the status frame's 0.01 %, and what TOLERANCE_MM makes of a stroke of a centimetre."""

HOSTS = {
    "mcu": lambda calibration, role="ifd": EmulatedEcu(load(ELF[role]), calibration, role),
    "host": HostEcu,
}


@pytest.fixture(params=[*HOSTS, "sanitized"])
def power_on(request):
    """Switches on an ECU: power_on(calibration, role)."""
    if request.param == "sanitized":
        return request.getfixturevalue("sanitized")
    if request.param == "host" and library() is None:
        pytest.skip("the host core is not built: no C compiler was found at installation")
    return HOSTS[request.param]


def message(name, **values):
    found = CODEC.message(name)
    physical = {key: values.get(key, 0) for key in found.signals}
    return Frame(found.id, CODEC.encode(name, physical).tobytes())


def cycle(alive):
    """The frames of one input cycle that both roles need."""
    return [
        message("STROKES", fork_stroke_mm=40, rear_stroke_mm=50, alive=alive & 15),
        message("MOTION", speed_kmh=60, alive=alive & 15),
    ]


class Wire:
    """Hands frames to an ECU a quarter of a millisecond apart, a cycle every 10 ms; collects its answers."""

    def __init__(self, ecu):
        self.ecu, self.t_ns = ecu, 0
        self.status, self.timing = CODEC.message(STATUS[ecu.name]).id, CODEC.message(STATUS[ecu.name]).id + 1

    def __call__(self, *frames):
        answers = []
        for frame in frames:
            answers += self.collect(self.t_ns)
            self.ecu.receive(frame, self.t_ns)
            self.t_ns += 250_000
        self.t_ns += 10 * MS - 250_000 * len(frames)
        return answers + self.collect(self.t_ns - MS)

    def collect(self, t_ns):
        answers = []
        while (request := self.ecu.advance(t_ns)) is not None:
            answers.append(request.frame)
            self.ecu.sent(request.handle, request.t_ns)
        return answers

    def decoded(self, *frames):
        """The signals of the one status and the one timing frame that `frames` lead to."""
        status, timing = self(*frames)
        assert (status.id, timing.id) == (self.status, self.timing)
        values = CODEC.decode(STATUS[self.ecu.name], status.data)
        return values, CODEC.decode(CODEC.message(timing.id).name, timing.data)


@pytest.fixture(params=ROLES)
def wire(request, power_on, calibration):
    return Wire(power_on(calibration, request.param))


# --- what any host promises ---------------------------------------------------------------------------------


def test_answers_each_complete_cycle_once(wire):
    """A complete input cycle gets one status and one timing frame; its frames repeated get none."""
    strokes, motion = cycle(3)
    assert len(wire(strokes, motion)) == 2
    assert wire(strokes, motion, motion) == []
    assert len(wire(*cycle(4))) == 2


def test_order_within_a_cycle_does_not_matter(wire):
    """The frames of a cycle may come in either order."""
    strokes, motion = cycle(0)
    assert len(wire(motion, strokes)) == 2


def test_incomplete_cycle(wire):
    """Half a cycle is no cycle, and halves of two cycles do not make one."""
    assert wire(cycle(0)[0]) == []
    assert wire(cycle(1)[1]) == []


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x0FF, bytes(4)),
        Frame(0x200, bytes(7)),
        Frame(0x7FF, bytes(8)),
        Frame(0x101, bytes(4)),
        Frame(0x101, bytes(6)),
        Frame(0x101, b""),
        Frame(0x101, bytes(5), extended=True),
        Frame(0x101 << 18, bytes(5), extended=True),
        message("ACCELERATIONS"),
    ],
    ids=lambda frame: f"{frame.id:x}{'x' if frame.extended else ''}-{len(frame.data)}",
)
def test_what_is_no_input_is_ignored(wire, frame):
    """Other identifiers, wrong lengths and 29-bit frames of the same number complete and spoil no cycle."""
    strokes, motion = cycle(0)
    assert wire(strokes, frame) == []
    values, timing = wire.decoded(motion)
    assert (values["alive"], timing["missed_inputs"]) == (0, 0)


def test_alive_is_echoed(wire):
    """Both answers echo the cycle's count, round its wrap; the steps are counted on."""
    for k in range(5, 25):
        values, timing = wire.decoded(*cycle(k))
        assert (values["alive"], timing["alive"], values["step"]) == (k & 15, k & 15, k - 4)


def test_missed_cycles_are_counted(wire):
    """Cycles of which nothing came, and cycles left incomplete, count as missed; the first is the start."""
    assert wire.decoded(*cycle(9))[1]["missed_inputs"] == 0
    assert wire.decoded(*cycle(10))[1]["missed_inputs"] == 0
    assert wire.decoded(*cycle(13))[1]["missed_inputs"] == 2
    wire(cycle(14)[0])
    assert wire.decoded(*cycle(15))[1]["missed_inputs"] == 3
    assert wire.decoded(*cycle(17))[1]["missed_inputs"] == 4


def test_count_of_missed_cycles_saturates(wire):
    """The count of missed cycles stays at what its bits hold."""
    for k in range(20):
        _, timing = wire.decoded(*cycle(15 * k))
    assert timing["missed_inputs"] == 255


def test_ready_after_the_warm_up(power_on, calibration):
    """The ready flag rises with the step that follows the last of the warm-up."""
    for role in ROLES:
        wire = Wire(power_on(calibration.with_detector(warmup=5), role))
        assert [wire.decoded(*cycle(k))[0]["ready"] for k in range(8)] == [0] * 5 + [1] * 3


def test_fresh_at_every_power_on(power_on, calibration):
    """What one ECU has seen is not in the next."""
    first, second = (Wire(power_on(calibration)) for _ in range(2))
    before = [first(*cycle(k)) for k in range(5)]
    after = [second(*cycle(k)) for k in range(5)]
    if isinstance(first.ecu, HostEcu):
        assert before == after
    assert [answers[0] for answers in before] == [answers[0] for answers in after]


def test_alarm_waits_for_the_warm_up(power_on, calibration):
    """With a threshold of zero the alarm still waits for the warm-up and n windows."""
    wire = Wire(power_on(calibration.with_detector(threshold=0.0, warmup=6, window=2, multiple=3)))
    alarms = [wire.decoded(*cycle(k))[0]["alarm"] for k in range(14)]
    assert alarms == [0] * 11 + [1] * 3


def test_step_cycles(power_on, calibration):
    """The MCU reports what its step took, the host that it cannot know."""
    wire = Wire(power_on(calibration))
    _, timing = wire.decoded(*cycle(0))
    assert (timing["step_cycles"] > 1000) == isinstance(wire.ecu, EmulatedEcu)
    assert timing["step_cycles"] == 0 or isinstance(wire.ecu, EmulatedEcu)
    assert timing["overruns"] == 0


# --- the same bytes -----------------------------------------------------------------------------------------


def statuses(ecu, lap, faults=()):
    """The status payloads of a ride, in order."""
    codes, _ = insert(acquire(lap), [parse_fault(text) for text in faults])
    watch = Watch(CODEC, ecu.name)
    done = ride(schedule(codes, CODEC), ecu, watch)
    assert done.failure is None
    wanted = CODEC.message(STATUS[ecu.name]).id
    return [d.frame.data for d in done.frames if d.frame.id == wanted]


def made(neurons=15, delays=10, shift=0, role="ifd", faults=(), seconds=20, **detector):
    return (Calibration(network(neurons, delays, shift=shift), Detector(**detector)), role, faults, seconds)


SAME = {
    "as-shipped": made(),
    "open": made(faults=["rear_stroke:open@6+5"]),
    "short": made(faults=["rear_stroke:short@6"]),
    "hold-uncalibration": made(faults=["rear_stroke:hold@4+3", "rear_stroke:uncalibration:gain=1.3@12"]),
    "faulty-inputs": made(faults=["fork_stroke:open@3", "pitch_rate:short@5", "speed:open@7"]),
    "shift-5": made(shift=5),
    "measured": made(feedback="measured", faults=["rear_stroke:open@6"]),
    "smallest": made(1, 1),
    "odd-shape": made(25, 7),
    "largest": made(32, 16, seconds=10),
    "long-window": made(window=128, multiple=3, warmup=0),
    "soft-sensor": made(role="soft_sensor"),
    "soft-sensor-shift-15": made(25, 7, shift=15, role="soft_sensor", seconds=10),
}


@pytest.mark.parametrize("case", SAME.values(), ids=SAME)
def test_same_bytes_on_both_hosts(case):
    """Emulated MCU and host core send the same prediction, residual and alarm over a lap, byte for byte."""
    if library() is None:
        pytest.skip("the host core is not built: no C compiler was found at installation")
    calibration, role, faults, seconds = case
    lap = wavy_lap(seconds)
    mcu, host = (statuses(make(calibration, role), lap, faults) for make in HOSTS.values())
    assert len(mcu) == 100 * seconds
    assert len(set(mcu)) > 50 * seconds
    assert mcu == host


# --- and the right ones -------------------------------------------------------------------------------------


def seen(lap, faults=()):
    """What the ECU decodes: inputs (cycles, 3) and the measured rear stroke (cycles,), float64."""
    codes, _ = insert(acquire(lap), [parse_fault(text) for text in faults])
    channels = sampled(codes)
    names = ("fork_stroke_mm", "pitch_rate_dps", "speed_kmh")
    return np.stack([channels[name] for name in names], axis=1), channels["rear_stroke_mm"]


def residuals(predicted, measured, detector):
    """E_mean,L of (V.1), relative, from zeros before the first sample."""
    deviation = np.abs(predicted - measured) / np.maximum(np.abs(measured), detector.floor_mm)
    padded = np.concatenate([np.zeros(detector.window - 1), deviation])
    return np.convolve(padded, np.ones(detector.window) / detector.window, "valid")


def decisions(residual, detector):
    """Figure V.8: an alarm while the residual has been above T for n windows on end, after the warm-up."""
    alarms, above = [], 0
    for k, value in enumerate(residual):
        above = above + 1 if k >= detector.warmup and value > detector.threshold else 0
        alarms.append(above >= detector.multiple * detector.window)
    return np.array(alarms)


def said(ecu, lap, faults=()):
    """The ECU's status signals over a lap, name -> float64 (cycles,)."""
    payload = np.frombuffer(b"".join(statuses(ecu, lap, faults)), np.uint8).reshape(-1, 8)
    return CODEC.decode_all("IFD_STATUS", payload)


def bounded(pct):
    return np.minimum(pct, 655.35)


@pytest.mark.parametrize("shape", [(1, 1), (15, 10), (25, 7)])
def test_prediction_is_the_networks(power_on, shape):
    """The prediction is the network's own free run in double precision, to the tolerance stated."""
    lap, net = wavy_lap(10), network(*shape)
    predicted = said(power_on(Calibration(net)), lap)["predicted_mm"]
    assert np.ptp(predicted) > 0.3
    np.testing.assert_allclose(predicted, net.free_run(seen(lap)[0]), rtol=0, atol=TOLERANCE_MM)


def test_shifted_prediction_waits_for_its_instant(power_on):
    """With shift 5 the answer given for an instant is the one computed 50 ms before it."""
    lap, net = wavy_lap(5), network(shift=5)
    expected = np.concatenate([np.full(5, net.initial_mm), net.free_run(seen(lap)[0])[:-5]])
    predicted = said(power_on(Calibration(net)), lap)["predicted_mm"]
    np.testing.assert_allclose(predicted, expected, rtol=0, atol=TOLERANCE_MM)


def test_measured_feedback(power_on):
    """Fed back with the measured stroke, the prediction is the series-parallel one, faulty stroke and all."""
    lap, net, faults = wavy_lap(5), network(), ["rear_stroke:open@2"]
    predicted = said(power_on(Calibration(net, Detector(feedback="measured"))), lap, faults)["predicted_mm"]
    np.testing.assert_allclose(predicted, net.one_step(*seen(lap, faults)), rtol=0, atol=TOLERANCE_MM)


@pytest.mark.parametrize("window", [1, 20, 128])
def test_residual_is_equation_v1(power_on, calibration, window):
    """The residual is the windowed mean of (V.1), of the prediction against what was measured."""
    lap, faults = wavy_lap(5), ["rear_stroke:open@2+1"]
    detector = Detector(window=window)
    given = said(power_on(replace(calibration, detector=detector)), lap, faults)["residual_pct"]
    u, measured = seen(lap, faults)
    expected = 100 * residuals(calibration.network.free_run(u), measured, detector)
    np.testing.assert_allclose(given, bounded(expected), rtol=0, atol=RESIDUAL_PCT)


def test_short_uses_the_floor(power_on, calibration):
    """A sensor shorted to 0 mm divides by the floor, not by zero."""
    lap, faults = wavy_lap(3), ["rear_stroke:short@1"]
    detector = Detector(floor_mm=40.0, window=4)
    given = said(power_on(replace(calibration, detector=detector)), lap, faults)["residual_pct"]
    u, measured = seen(lap, faults)
    assert (measured[100:] == 0).all()
    expected = 100 * residuals(calibration.network.free_run(u), measured, detector)
    assert expected[110:].max() < 600
    np.testing.assert_allclose(given, expected, rtol=0, atol=RESIDUAL_PCT)


def test_residual_beyond_its_frame_saturates(power_on, calibration):
    """A residual larger than its signal's bits is sent as the largest they hold."""
    given = said(power_on(calibration), wavy_lap(2), ["rear_stroke:short@1"])["residual_pct"]
    assert given[-1] == pytest.approx(655.35)


@pytest.mark.parametrize(("window", "multiple"), [(1, 1), (5, 4), (20, 2)])
def test_decision_is_figure_v8(power_on, calibration, window, multiple):
    """The alarm rises after n windows above T on end, falls with the residual, and starts anew."""
    lap, faults = wavy_lap(8), ["rear_stroke:open@2+1.5", "rear_stroke:short@5+0.6"]
    detector = Detector(threshold=0.55, window=window, multiple=multiple, warmup=50)
    alarms = said(power_on(replace(calibration, detector=detector)), lap, faults)["alarm"]
    u, measured = seen(lap, faults)
    residual = residuals(calibration.network.free_run(u), measured, detector)
    assert np.abs(residual - detector.threshold).min() > 1e-5, "too close to call in single precision"
    expected = decisions(residual, detector)
    assert np.count_nonzero(np.diff(expected)) >= 2, "the alarm was to rise and to fall"
    np.testing.assert_array_equal(alarms, expected)


def test_soft_sensor_needs_no_rear_stroke(power_on, calibration):
    """The soft sensor predicts what the IFD predicts, whatever the rear stroke sensor says."""
    lap = wavy_lap(2)
    soft = statuses(power_on(calibration, "soft_sensor"), lap, ["rear_stroke:short@0"])
    payload = np.frombuffer(b"".join(soft), np.uint8).reshape(-1, 5)
    predicted = CODEC.decode_all("SOFT_STROKE", payload)["predicted_mm"]
    np.testing.assert_array_equal(predicted, said(power_on(calibration), lap)["predicted_mm"])

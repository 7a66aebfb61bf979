"""Calibration files: they come back as they were, and whatever is wrong with one is one line, no more."""

import copy
import json
import re
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc import CHANNELS
from targets.calibration import MAX_WEIGHT, ROOM, Calibration, Detector, dumps, load, loads
from targets.ecus import DEFAULT_CALIBRATION
from targets.errors import CalibrationError
from targets.narx.network import Narx
from tests.conftest import network


@pytest.fixture(scope="module")
def document():
    """A calibration file's content, small enough to read in a failure."""
    return json.loads(dumps(Calibration(network(2, 1), Detector(window=7), {"seed": 3})))


def refusal(text):
    """The one line that refuses `text`."""
    with pytest.raises(CalibrationError) as caught:
        loads(text, source="file.json")
    line = str(caught.value)
    assert line.startswith("file.json: ")
    assert "\n" not in line
    return line


# --- there and back -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(1, 1), (15, 10), (32, 16)])
def test_comes_back(shape):
    """A calibration written and read is the same: to the text, and to every bit of its image."""
    net = network(*shape, shift=3)
    detector = Detector(0.2, 13, 7, "predicted", 11, 0.5)
    calibration = Calibration(net, detector, {"seed": 1, "laps": ["a", "b"]})
    again = loads(dumps(calibration))
    assert dumps(again) == dumps(calibration)
    assert again.image() == calibration.image()
    assert (again.detector, again.provenance) == (detector, calibration.provenance)
    for name in ("inputs", "output", "delays", "shift", "input_ranges", "output_range", "initial_mm"):
        assert getattr(again.network, name) == getattr(net, name)


@settings(max_examples=30)
@given(st.lists(st.floats(-MAX_WEIGHT, MAX_WEIGHT, width=32), min_size=9, max_size=9))
def test_any_weight_comes_back(values):
    """Every single-precision weight survives its decimal text, subnormal ones, too."""
    net = replace(network(2, 1), W1=np.array(values[:8]).reshape(2, 4), b2=values[8])
    assert loads(dumps(Calibration(net))).image() == Calibration(net).image()


def test_text_is_plain_numbers():
    """The file is JSON of numbers and text, floats written as short as single precision allows."""
    text = dumps(Calibration(replace(network(1, 1), b2=float(np.float32(0.1)))))
    assert json.loads(text)["network"]["output_bias"] == 0.1


def test_image_is_laid_out_as_the_header_says(calibration):
    """The image holds what calibration.h reads: head, scalings, padded rows of weights, and its checksum."""
    image, net = calibration.image(), calibration.network
    magic, version, size, crc = struct.unpack_from("<4I", image)
    assert (magic, version, size) == (int.from_bytes(b"SCAL", "little"), 2, len(image))
    assert crc == zlib.crc32(image[16:])
    assert calibration.checksum == f"{crc:08x}"
    assert struct.unpack_from("<8I", image, 16) == (15, 10, 3, 0, 0, 20, 5, 200)
    threshold, floor, initial, gain, offset, scale = struct.unpack_from("<6f", image, 48)
    assert (threshold, floor) == pytest.approx((0.1, 0.1))
    assert (initial, gain, offset, scale) == pytest.approx((55, 55, 55, 1 / 55))
    channels = [struct.unpack_from("<Iff", image, 128 + 12 * k) for k in range(7)]
    assert channels[0] == pytest.approx((0, 75, 1 / 75))
    assert channels[1] == pytest.approx((2, 0, 1 / 80))
    assert channels[3:] == [(0, 0, 0)] * 4
    weights = np.frombuffer(image, "<f4", offset=216)
    rows, outputs = weights[:-15].reshape(15, 41), weights[-15:]
    np.testing.assert_array_equal(rows[:, 0], net.b1)
    np.testing.assert_array_equal(rows[:, 1:], net.W1)
    np.testing.assert_array_equal(outputs, net.w2)
    assert struct.unpack_from("<f", image, 212) == (np.float32(net.b2),)


def test_rows_are_padded_with_zeros():
    """Rows whose length is no multiple of four are padded, so that the firmware's loop needs no remainder."""
    # three regressors: two inputs of one delay each, and the fed-back stroke
    small = Narx(
        inputs=("fork_stroke_mm", "speed_kmh"),
        output="rear_stroke_mm",
        delays=1,
        input_ranges=((0, 150), (0, 200)),
        output_range=(0, 110),
        W1=np.ones((2, 3)),
        b1=np.full(2, 2.0),
        w2=np.full(2, 3.0),
        b2=0,
        initial_mm=55,
    )
    weights = np.frombuffer(Calibration(small).image(), "<f4", offset=216)
    assert weights.tolist() == [2, 1, 1, 1, 0, 2, 1, 1, 1, 0, 3, 3]


def test_provenance_is_no_part_of_it(calibration):
    """Where a calibration came from changes neither its image nor whether two are equal."""
    noted = replace(calibration, provenance={"seed": 9})
    assert noted == calibration
    assert noted.checksum == calibration.checksum


def test_other_detector_settings(calibration):
    """The same network with other detector settings is another image with the same weights."""
    other = calibration.with_detector(threshold=0.5)
    assert other.detector.threshold == 0.5
    assert other.network is calibration.network
    assert other.checksum != calibration.checksum


def test_shipped_calibration():
    """The shipped calibration is a good one, and needs channels that the logger sends."""
    calibration = load(DEFAULT_CALIBRATION)
    assert calibration.network.output == "rear_stroke_mm"
    assert len(calibration.image()) <= ROOM


# --- what is refused ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not JSON"),
        ("weights", "not JSON"),
        ("{", "not JSON"),
        (b"\xff\xfe\x00\x01", "not JSON"),
        (b"\x80abc", "not JSON"),
        ('{"a": 1}{}', "not JSON"),
        ("1" * 5000, "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("null", "not a strokebench-calibration file"),
        ("[]", "not a strokebench-calibration file"),
        ('"strokebench-calibration"', "not a strokebench-calibration file"),
        ('{"format": "other"}', "not a strokebench-calibration file"),
        ('{"format": "strokebench-calibration"}', "version None, this strokebench reads version 2"),
        ('{"format": "strokebench-calibration", "version": 2}', "network is missing or not a dict"),
    ],
    ids=lambda value: repr(value)[:24],
)
def test_no_calibration_file(text, says):
    """What is no JSON, or JSON of something else, is refused as that."""
    assert says in refusal(text)


@pytest.mark.parametrize("version", [1, 0, "2", True, None, 1.5, [1]])
def test_other_version(document, version):
    """A file of another version is refused with its version and the one that can be read."""
    line = refusal(json.dumps({**document, "version": version}))
    assert line == f"file.json: version {version!r}, this strokebench reads version 2"


@pytest.mark.parametrize("checksum", ["00000000", None, 5, "f" * 100, ["x"]])
def test_wrong_checksum(document, checksum):
    """Content that does not match its checksum is refused with both."""
    assert f"checksum {checksum!r} does not match" in refusal(json.dumps({**document, "checksum": checksum}))


def test_one_digit_changed(document):
    """A single digit of a weight changed by hand is found by the checksum."""
    changed = copy.deepcopy(document)
    changed["network"]["hidden_weights"][0][0] += 0.001
    assert "does not match the content" in refusal(json.dumps(changed))


def with_value(document, where, value):
    changed = copy.deepcopy(document)
    place = changed
    for key in where[:-1]:
        place = place[key]
    place[where[-1]] = value
    return json.dumps(changed)


NET, DET = ("network",), ("detector",)

WRONG_SIZES = [
    ((*NET, "hidden_weights"), [[0.0] * 4], "hidden_weights has 1 rows for 2 neurons"),
    ((*NET, "hidden_weights"), [[0.0] * 4] * 3, "hidden_weights has 3 rows for 2 neurons"),
    ((*NET, "hidden_weights", 1), [0.0] * 3, "hidden_weights row 1 has 3 weights; 3 inputs .* need 4"),
    ((*NET, "hidden_weights", 1), [0.0] * 5, "hidden_weights row 1 has 5 weights"),
    ((*NET, "hidden_weights", 1), "four", "hidden_weights row 1 has 'four' weights"),
    ((*NET, "hidden_biases"), [0.0] * 3, "hidden_weights has 2 rows for 3 neurons"),
    ((*NET, "hidden_biases"), [], "neurons is 0, the ECU takes 1 to 32"),
    ((*NET, "hidden_biases"), [0.0] * 33, "neurons is 33, the ECU takes 1 to 32"),
    ((*NET, "output_weights"), [0.0], "output_weights has 1 weights for 2 neurons"),
    ((*NET, "output_weights"), [0.0] * 3, "output_weights has 3 weights for 2 neurons"),
    ((*NET, "delays"), 2, "hidden_weights row 0 has 4 weights; .* 2 delays need 8"),
    ((*NET, "delays"), 17, "delays is 17, the ECU takes 1 to 16"),
    ((*NET, "delays"), 0, "delays is 0, the ECU takes 1 to 16"),
    ((*NET, "shift"), 16, "shift is 16, the ECU takes 0 to 15"),
    ((*NET, "shift"), -1, "delays 1, shift -1: at least 1 and 0"),
    ((*NET, "inputs"), [], "hidden_weights row 0 has 4 weights; 0 inputs"),
    ((*NET, "inputs", 0), "fork", "network input 'fork' is not a table"),
    ((*NET, "inputs", 0, "range"), [0, 1, 2], r"range is \[0, 1, 2\], not \[low, high\]"),
    ((*NET, "inputs", 0, "range"), [5, 5], r"range \[5, 5\] is empty"),
    ((*NET, "inputs", 0, "range"), [0, 1e-9], "width is 1e-09"),
    ((*NET, "inputs", 0, "range"), [-1e9, 1], "low end is -1000000000.0"),
    ((*NET, "output", "range"), [0, 1e-300], "range of 'rear_stroke_mm': width"),
    ((*NET, "inputs", 0, "channel"), "mood", "unknown input 'mood'; the ECU knows fork_stroke_mm"),
    ((*NET, "inputs", 0, "channel"), "new\nline", r"unknown input 'new\\nline'"),
    ((*NET, "inputs", 0, "channel"), "speed_kmh", "one or more distinct channels"),
    ((*NET, "initial_mm"), 1e30, "initial_mm is 1e\\+30, the ECU takes"),
    ((*NET, "output_weights", 0), 1e30, "largest of w2 is 1e\\+30, the ECU takes 0 to 1000000000.0"),
    ((*DET, "window"), 0, "window is 0, the ECU takes 1 to 128"),
    ((*DET, "window"), 129, "window is 129, the ECU takes 1 to 128"),
    ((*DET, "window"), 20.0, "window is 20.0, not an integer"),
    ((*DET, "multiple"), 0, "multiple is 0, the ECU takes 1 to 10000"),
    ((*DET, "multiple"), 10**40, "multiple is 1000"),
    ((*DET, "warmup"), -1, "warmup is -1, the ECU takes 0 to 1000000"),
    ((*DET, "threshold"), -0.1, "threshold is -0.1"),
    ((*DET, "floor_mm"), 0, "floor_mm is 0.0, the ECU takes 1e-06"),
    ((*DET, "feedback"), "both", "feedback 'both' is neither predicted nor measured"),
    ((*DET, "feedback"), 1, "feedback is 1, not a word"),
    (NET, [], "network is missing or not a dict"),
    (DET, None, "detector is missing or not a dict"),
]


@pytest.mark.parametrize(("where", "value", "says"), WRONG_SIZES, ids=lambda value: repr(value)[:30])
def test_part_that_does_not_fit(document, where, value, says):
    """A part of the wrong size, kind or range is refused with its name and what was found."""
    assert re.search(says, refusal(with_value(document, where, value)))


NUMBERS = [
    (*NET, "hidden_weights", 0, 0),
    (*NET, "hidden_biases", 1),
    (*NET, "output_weights", 0),
    (*NET, "output_bias"),
    (*NET, "initial_mm"),
    (*NET, "inputs", 0, "range", 1),
    (*NET, "output", "range", 0),
    (*DET, "threshold"),
    (*DET, "floor_mm"),
]


NO_NUMBERS = [float("nan"), float("inf"), float("-inf"), 1e39, -1e300, 10**400, True, "1.0", None, [], {}]


@pytest.mark.parametrize("where", NUMBERS, ids=lambda where: ".".join(map(str, where)))
def test_what_is_no_number(document, where):
    """NaN, infinities, numbers too large for single precision, booleans and text are refused as numbers."""
    name = next(key for key in reversed(where) if isinstance(key, str))
    for value in NO_NUMBERS:
        line = refusal(with_value(document, where, value))
        assert f"{name} is {value!r}, not a finite" in line or f"{name} holds {value!r}, not a finite" in line


def test_image_too_large_for_its_sector():
    """A network whose parts are all within bounds but whose image is not is refused with both sizes."""
    large = replace(
        network(32, 16), inputs=CHANNELS, input_ranges=((0.0, 1.0),) * 7, W1=np.zeros((32, 8 * 16))
    )
    with pytest.raises(CalibrationError, match=r"image of \d{5} bytes exceeds its flash sector of 16384"):
        Calibration(large)


@pytest.mark.parametrize(
    ("name", "says"), [("none.json", "no such file"), (".", "is a directory"), ("a" * 300, "name too long")]
)
def test_file_that_cannot_be_read(tmp_path, name, says):
    """A path that is no readable file is one line that names it."""
    with pytest.raises(CalibrationError, match=says) as caught:
        load(tmp_path / name)
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("where", "says"),
    [
        (NET, "network is missing"),
        ((*NET, "inputs", 0), "network input [[["),
        ((*DET, "threshold"), "threshold is [[["),
        (("checksum",), "checksum [[["),
        (("version",), "version [[["),
    ],
)
def test_deep_nesting(document, where, says):
    """Lists in lists are refused in one line that names their place, or as no JSON where too deep to read."""
    text = with_value(document, where, "@")
    lines = [
        refusal(text.replace('"@"', "[" * depth + "]" * depth))
        for depth in (10, 100, 300, 500, *range(700, 1000, 7), 100_000)
    ]
    assert all(line.startswith((f"file.json: {says}", "file.json: not JSON")) for line in lines)
    assert says in lines[0]
    assert "not JSON" in lines[-1]


# --- whatever else may be in a file -------------------------------------------------------------------------

TEXT = dumps(Calibration(network(2, 1), Detector(window=7)))

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.just(10**400),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=4),
    max_leaves=6,
)


def places(value, here=()):
    """The paths of everything in a document."""
    yield here
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield from places(inner, (*here, key))


def one_line_or_calibration(text):
    """What `text` is, None if it was refused in one line."""
    line = ""
    try:
        return loads(text)
    except CalibrationError as error:
        line = str(error)
    assert line
    assert "\n" not in line
    return None


PLACES = [where for where in places(json.loads(TEXT)) if where]


@settings(max_examples=100)
@given(st.lists(st.tuples(st.sampled_from(PLACES), VALUES), min_size=1, max_size=3))
def test_any_value_anywhere(changes):
    """A file with anything in place of anything is a calibration or one line, never something else."""
    document = json.loads(TEXT)
    for where, value in changes:
        place = document
        try:
            for key in where[:-1]:
                place = place[key]
            place[where[-1]] = value
        except (TypeError, KeyError, IndexError):
            continue  # an earlier change has taken this place away
    calibration = one_line_or_calibration(json.dumps(document))
    assert calibration is None or calibration.checksum == document["checksum"]


@settings(max_examples=150)
@given(st.data())
def test_any_bytes_changed(data):
    """A file with bytes replaced, cut or put in is the same calibration, to every bit, or one line."""
    content = bytearray(TEXT.encode())
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(content) - 1))
        stop = data.draw(st.integers(start, min(len(content), start + 40)))
        content[start:stop] = data.draw(st.binary(max_size=8))
    calibration = one_line_or_calibration(bytes(content))
    assert calibration is None or calibration.image() == loads(TEXT).image()


def test_measured_feedback_has_no_future():
    """Feeding back a stroke that lies ahead in time is refused."""
    with pytest.raises(CalibrationError, match="feedback measured with shift 5"):
        Calibration(network(shift=5), Detector(feedback="measured"))


def test_measured_feedback_comes_back():
    """The other feedback travels through file and image, too."""
    calibration = Calibration(network(), Detector(feedback="measured"))
    assert loads(dumps(calibration)).image() == calibration.image()
    assert loads(dumps(calibration)).detector.feedback == "measured"

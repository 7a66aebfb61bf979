"""Sensors from TOML: the shipped data sheets, and what is refused."""

import re
from pathlib import Path

import pytest

from bench.errors import SensorError
from bench.sensors.datasheets import DATASHEET, load_sensors
from bench.sensors.parts import IDEAL, Mems, Potentiometer
from bench.sensors.transducers import TRANSDUCERS

RING = "[970-011]\nteeth = 48\ncircumference_m = 1.9\n"


def written(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_names():
    """The two names are known, and ideal sensors have no parts."""
    assert load_sensors("ideal") is IDEAL
    assert load_sensors("datasheet").name == "datasheet"


def test_datasheets_cover_the_table():
    """Every model of Table II.1 has its data sheet."""
    assert set(load_sensors("datasheet").parts) == {row.model for row in TRANSDUCERS.values()}
    assert load_sensors("datasheet").logger is not None


def test_every_figure_has_a_source():
    """Beside each figure of the data sheets stands where it is from."""
    figures = [line for line in DATASHEET.read_text(encoding="utf-8").splitlines() if " = " in line]
    figures = [line for line in figures if not line.startswith("#")]
    assert len(figures) > 40
    for line in figures:
        assert re.search(r"# (sheet|register|secondary|recalled|assumed): |# assumed, as ", line), line


def test_left_out_is_ideal(tmp_path):
    """A file with one figure has no other imperfection; whole numbers will do."""
    sensors = load_sensors(written(tmp_path, "[L3GD20]\nnoise_density = 1\n[SLS130]\n"))
    assert sensors.parts == {"L3GD20": Mems(noise_density=1.0), "SLS130": Potentiometer()}
    assert sensors.logger is None


def test_path_as_text(tmp_path):
    """A file may be given as text."""
    assert load_sensors(str(written(tmp_path, RING))).parts["970-011"].teeth == 48


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[SLS131]\n", "unknown part SLS131; the known ones are SLS130,"),
        ("SLS130 = 3\n", "SLS130 is 3, not a table"),
        ("[SLS130]\nlinarity = 1\n", "unknown key SLS130.linarity"),
        ("[L3GD20]\nnoise_density = -0.03\n", "L3GD20.noise_density is -0.03, below zero"),
        ("[L3GD20]\nnoise_density = 'low'\n", "L3GD20.noise_density is 'low', not a number"),
        ("[L3GD20]\nnoise_density = true\n", "L3GD20.noise_density is True, not a number"),
        ("[L3GD20]\nnoise_density = nan\n", "L3GD20.noise_density is nan, not a finite number"),
        ("[L3GD20]\nodr_hz = inf\n", "L3GD20.odr_hz is inf, not a finite number"),
        ("[L3GD20]\nunit = 0.0\n", "L3GD20.unit is 0.0; it must be above"),
        ("[L3GD20]\nlowpass_order = 3\n", "L3GD20.lowpass_order is 3, above 2"),
        ("[L3GD20]\nlowpass_order = 0\n", "L3GD20.lowpass_order is 0; it must be above"),
        ("[L3GD20]\nlowpass_order = 1.0\n", "L3GD20.lowpass_order is 1.0, not a whole number"),
        ("[SLS130]\nlinearity = 0.9\n", "SLS130.linearity is 0.9, above 0.5"),
        ("[logger]\nreference_follows = 1.5\n", "logger.reference_follows is 1.5, above 1"),
        ("[970-011]\nteeth = 48\n", "missing 970-011.circumference_m"),
        (RING + "edge_error = 0.05\nrunout = 5.0\n", "leave no gap between two of 48 teeth"),
        ("[SLS130\n", "not TOML"),
    ],
)
def test_refusals(tmp_path, text, message):
    """What no part can be is refused by file, key and value, in one line."""
    path = written(tmp_path, text)
    with pytest.raises(SensorError) as refused:
        load_sensors(path)
    assert str(refused.value).startswith(str(path))
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["datasheets", "sensors.json", ""])
def test_unknown_name(name):
    """A name that is neither known nor a TOML file is refused with what would do."""
    with pytest.raises(SensorError, match=r"neither datasheet, ideal nor a \.toml file"):
        load_sensors(name)


def test_missing_file(tmp_path):
    """A file that is not there is refused by its path."""
    with pytest.raises(SensorError, match="cannot be read"):
        load_sensors(tmp_path / "none.toml")


def test_side():
    """The message shown to the user opens with the side at fault."""
    assert SensorError.side == "sensor"
    assert Path(DATASHEET).name == "datasheets.toml"

"""The codes of the procedure timed: what a step takes, what the table says, the lowest clock."""

from dataclasses import replace

import numpy as np
import pytest

from bench.errors import LapError
from bench.sensors.parts import IDEAL
from campaigns import timing
from campaigns.thesis import thesis
from campaigns.timing import CLOCKS_HZ, CODES, LIMIT_US, MARGIN, codes, frames_of, lowest_clock, measure
from targets.ecus import build
from targets.errors import FirmwareError
from targets.firmware import clock
from targets.firmware.variants import LADDER
from tests.conftest import wavy_lap

STEPS = 8


@pytest.fixture(scope="module")
def base():
    """The shipped IFD."""
    return build()


@pytest.fixture(scope="module")
def frames(base):
    """What the logger sends in the cycles to be timed, and the one before them."""
    return frames_of(wavy_lap(0.5), base, IDEAL, STEPS + 1)


@pytest.fixture(scope="module")
def table(base, frames):
    """Every code at 22 and 84 MHz."""
    return list(codes(frames, base, CLOCKS_HZ[:2]))


def test_every_code_at_every_clock(table):
    """The table has a row for each clock and code, each of as many steps as were asked for."""
    assert [(steps.hz, steps.code) for steps in table] == [
        (hz, code) for hz in CLOCKS_HZ[:2] for code in CODES
    ]
    assert {steps.pulses.shape for steps in table} == {(STEPS, 3)}


def test_each_code_is_faster_than_the_one_before(table):
    """At either clock STEP 3 is faster than STEP 2, and STEP 4 at least ten times as fast as STEP 3."""
    for row in (table[:3], table[3:]):
        initial, compiled, final = (steps.document()["mean_us"] for steps in row)
        assert initial > compiled > 10 * final


def test_the_final_code_keeps_its_promise(table):
    """At 22 MHz a step of the shipped code takes at most 230 us, the first one after power-on included."""
    final = table[2]
    assert final.code == "final"
    assert final.document()["mean_us"] <= 230
    assert final.slowest_us <= 230


def test_published_figures_stand_beside(table):
    """At the table's clocks the thesis's mean and deviation stand beside ours, at others nothing does."""
    published = thesis()["firmware"]["time_us"]
    for k, steps in enumerate(table):
        row = steps.document()
        assert [row["thesis_mean_us"], row["thesis_std_us"]] == published[k // 3][k % 3]
    elsewhere = replace(table[0], hz=24_000_000).document()
    assert elsewhere["thesis_mean_us"] is None


def test_times_are_cycles_at_the_clock(table):
    """Microseconds are cycles over megahertz; the soft sensor alone takes less than the whole step."""
    for steps in table:
        row = steps.document()
        assert row["mean_us"] == pytest.approx(row["cycles"] / row["clock_mhz"])
        assert row["min_us"] <= row["mean_us"] <= row["max_us"]
        assert 0.5 * row["mean_us"] < row["narx_mean_us"] < row["mean_us"]


def test_bounds(table):
    """Bounds are printed where the model gives them, and the pessimistic one counts as the slowest."""
    steps = table[2]
    model = steps.pulses[:, 0]
    bounded = replace(steps, pulses=np.stack([model, model - 100, model + 5000], axis=1))
    best, worst = bounded.document()["bounds_us"]
    assert (best, worst) == pytest.approx(((model.mean() - 100) / 22, (model.mean() + 5000) / 22))
    assert bounded.slowest_us == pytest.approx((model.max() + 5000) / 22)
    assert replace(steps, pulses=np.stack([model, 0 * model, 0 * model], axis=1)).bounds is None


def test_memory(table, base):
    """Memory rows add up, and the thesis's kilobytes stand beside them."""
    row = timing.memory(table[2], base)
    assert row["flash_bytes"] == row["program_bytes"] + row["calibration_bytes"] <= 12 * 1024
    assert row["ram_bytes"] == row["variables_bytes"] + row["stack_bytes"] <= 6 * 1024
    assert (row["thesis_flash_kB"], row["thesis_ram_kB"]) == (24, 40)


def test_lowest_clock(table, base, frames):
    """The lowest clock leaves the margin, at most 6 MHz will do, and the next lower one does not."""
    allowed = LIMIT_US * (1 - MARGIN)
    found = lowest_clock(frames, base, table[2])
    assert found.hz <= 6_000_000
    assert found.slowest_us <= allowed
    below = [setting.hz for setting in clock.settings() if setting.hz < found.hz]
    assert below
    assert measure("final", replace(base, clock_hz=below[-1]), frames).slowest_us > allowed


def test_no_clock_is_fast_enough(table, base, frames):
    """Where even the highest clock is too slow there is none."""
    assert lowest_clock(frames, base, table[2], limit_us=1.0) is None
    assert timing.lowest_document("final", None)["clock_mhz"] is None


def test_practices(arm_gcc, base, frames, monkeypatch):
    """Practices are built and timed in their order; the FPU, and doing without the library, pay."""
    assert [*LADDER][:: len(LADDER) - 1] == ["initial", "final"]
    monkeypatch.setattr(timing, "LADDER", {name: LADDER[name] for name in ("O3", "fpu", "single")})
    rows = timing.ladder(frames, base)
    assert [row["practice"] for row in rows] == ["O3", "fpu", "single"]
    times = [row["mean_us"] for row in rows]
    assert times[0] > 2 * times[1] > 4 * times[2]


def test_a_lap_that_is_too_short(base):
    """A lap with fewer cycles than steps to be timed is refused."""
    with pytest.raises(LapError, match="shorter than the 60 steps"):
        frames_of(wavy_lap(0.5), base, IDEAL, 60)


def test_code_that_is_too_slow_for_the_logger(base, frames):
    """A code whose step outlasts the logger's period has no time to print, but an overrun."""
    slow = next(timing.builds(base, ["initial"]))
    with pytest.raises(FirmwareError, match=r"initial.elf at 4 MHz: ECU overrun"):
        measure("initial", replace(slow, clock_hz=4_000_000), frames)


def test_profile(base, frames):
    """The profile of a short ride leaves out the first step alone, and finds the network."""
    counted = timing.profile(frames, base)
    assert counted.pulses == STEPS
    assert counted.by_function()[0][0] == "narx_step"

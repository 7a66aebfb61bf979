"""What became of a campaign's runs: counts, rates, bounds and times of rows."""

import json
import random

import pytest

from campaigns.outcomes import expected_kind, outcomes
from tests.campaigns.synthetic import HZ, row

ROWS = [
    *(row("hold", "CD", k, td, "hold") for k, td in enumerate([0.4, 0.5, 0.6, 1.5])),
    row("hold", "MD", 10),
    row("hold", "FA", 11),
    row("hold", "ID", 12, named="open"),
    row("hold", "INVALID", 13, 9.0, "hold", reason="frames lost: 3"),
    row("open", "MD", 20),
    row("open", "INVALID", 21, reason="never acted"),
    *(row("fault-free", "OK", k, ridden_s=1800.0) for k in range(30, 34)),
    row("fault-free", "INVALID", 34, ridden_s=1800.0, alarms=7),
]


def table(rows=ROWS, **how):
    return outcomes(rows, **how)


def condition(key, found=None):
    (group,) = [group for group in (found or table())["conditions"] if group["key"] == key]
    return group


def test_invalid_stands_first_and_enters_no_rate():
    """INVALID runs head the document with their reasons, and no rate counts them."""
    found = table()
    assert list(found)[:2] == ["n", "invalid"]
    assert (found["n"], found["invalid"]["n"]) == (15, 3)
    assert [run["reason"] for run in found["invalid"]["runs"]] == [
        "frames lost",
        "frames lost: 3",
        "never acted",
    ]
    hold = condition("hold", found)
    assert (hold["invalid"], hold["n"]) == (1, 7)
    assert sum(hold[outcome] for outcome in ("CD", "MD", "FA", "ID")) == 7
    assert found["fault_free"][0]["n"] == 4


def test_rates():
    """Each outcome is a rate of the valid runs with Wilson's interval."""
    hold = condition("hold")
    assert [hold[outcome] for outcome in ("CD", "MD", "FA", "ID")] == [4, 1, 1, 1]
    assert hold["rates"]["CD"]["value"] == 4 / 7
    # Wilson, 4 of 7
    assert hold["rates"]["CD"]["interval"] == pytest.approx([0.2505, 0.8418], abs=5e-5)


def test_coverage_is_a_lower_bound():
    """The diagnostic coverage supported is Clopper and Pearson's bound: 20 of 20 support 86 %."""
    rows = [row("open", "CD", k, 0.04) for k in range(20)]
    assert condition("open", table(rows))["coverage"] == pytest.approx(0.05 ** (1 / 20))
    assert condition("hold")["coverage"] == pytest.approx(0.2253, abs=5e-5)


def test_times_are_of_correct_detections():
    """Times are of the correct detections alone; a miss is counted and in no mean."""
    td = condition("hold")["td_s"]
    assert (td["n"], td["censored"]) == (4, 1)
    assert (td["mean"], td["median"], td["max"]) == pytest.approx((0.75, 0.55, 1.5))
    assert td["p95"] == pytest.approx(0.6 + 0.85 * 0.9)
    assert td["sigma"] == pytest.approx(0.506623)


def test_median_of_all():
    """Over all faults what was not detected correctly is infinite: no median where that is half of them."""
    assert condition("hold")["td_s"]["median_of_all"] == 1.5
    rows = [row("hold", "CD", 1, 0.5), row("hold", "MD", 2)]
    assert condition("hold", table(rows))["td_s"]["median_of_all"] is None


def test_nothing_detected():
    """Where nothing was detected there is no time, not one of zero; and the document is JSON."""
    open_ = condition("open")
    assert open_["td_s"] == {
        **dict.fromkeys(("mean", "sigma", "median", "p95", "max", "median_of_all")),
        "n": 0,
        "censored": 1,
    }
    json.dumps(table(), allow_nan=False)


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        ("rear_stroke:open@1", "open"),
        ("rear_stroke:short@1", "short"),
        ("rear_stroke:short:to=gnd@1+2", "short"),
        ("rear_stroke:short:to=batt@1", "open"),
        ("rear_stroke:hold@1", "hold"),
        ("rear_stroke:uncalibration:gain=0.9@1", "uncalibration"),
        ("rear_stroke:offset:by=3@1", "uncalibration"),
        ("rear_stroke:a_kind_of_later_years@1", None),
        ("", None),
    ],
)
def test_expected_kind(fault, kind):
    """A fault is to be named as the kind it looks like: an unknown one as nothing."""
    assert expected_kind(fault) == kind


def test_named_right():
    """Of the alarms in time, those that name a kind are judged, whatever verdict that brought them."""
    rows = [
        row("hold", "CD", 1, 0.5, "hold"),
        row("hold", "CD", 2, 0.5, "open"),
        row("hold", "ID", 3, named="short"),
        row("hold", "CD", 4, 0.5),
        row("hold", "FA", 5, named="hold"),
        row("unheard_of", "CD", 6, 0.5, "hold"),
    ]
    named = condition("hold", table(rows))["named"]
    assert (named["right"], named["n"], named["value"]) == (1, 3, 1 / 3)
    assert condition("unheard_of", table(rows))["named"]["value"] is None


def test_ftti_margin():
    """The margin is what detection leaves of the interval; late and missed runs are beyond it."""
    assert condition("hold")["ftti"] is None
    ftti = condition("hold", table(ftti_s=1.0))["ftti"]
    assert (ftti["ftti_s"], ftti["beyond"]) == (1.0, 2)
    assert ftti["margin_max_s"] == pytest.approx(-0.5)
    assert ftti["margin_p95_s"] == pytest.approx(1.0 - 1.365)


def test_ftti_of_the_trials():
    """The trials' own interval serves where none is given, the shortest of several."""
    rows = [row("hold", "CD", k, 0.5, ftti_s=limit) for k, limit in enumerate([2.0, 1.0])]
    assert condition("hold", table(rows))["ftti"]["ftti_s"] == 1.0


def test_fault_free():
    """Laps without a fault: hours of the valid ones, and 3/T alarms an hour after none."""
    (free,) = table()["fault_free"]
    assert (free["n"], free["OK"], free["FA"], free["alarms"], free["hours"]) == (4, 4, 0, 0, 2.0)
    assert free["alarms_per_h_at_most"] == 1.5


def test_every_false_alarm_counts():
    """Alarms are counted, not laps with one: the bound is that of their number."""
    rows = [row("fault-free", "FA", k, ridden_s=3600.0, alarms=5) for k in range(2)]
    (free,) = table(rows)["fault_free"]
    assert (free["FA"], free["alarms"]) == (2, 10)
    assert free["alarms_per_h_at_most"] == pytest.approx(16.962 / 2, abs=1e-3)


def test_sweep():
    """A sweep's parameters make groups of their own, by size."""
    rows = [
        row("hold", "CD", k, 0.5, parameters={"load_kg": load, "route": route})
        for k, (load, route) in enumerate([(10, "b"), (9, "a"), (10, "a"), (9, "b")])
    ]
    keys = [group["key"] for group in table(rows)["conditions"]]
    assert keys == [f"hold[load_kg={load},route={route}]" for load in (9, 10) for route in "ab"]


def test_order():
    """Conditions stand as told, others follow by name."""
    assert [group["key"] for group in table()["conditions"]] == ["hold", "open"]
    assert [group["key"] for group in table(order=["open"])["conditions"]] == ["open", "hold"]


def test_order_of_rows_is_nothing():
    """The document does not depend on who finished first."""
    mixed = random.sample(ROWS, len(ROWS))
    assert json.dumps(table(mixed)) == json.dumps(table())


def test_steps():
    """Step times are pooled over the valid runs of each ECU with a clock, in microseconds of it."""
    steps = {"n": 2, "cycles": 16500, "squares": 5500**2 + 11000**2, "least": 5500, "most": 11000, "hz": HZ}
    rows = [
        row("hold", "CD", 1, 0.5),
        row("hold", "CD", 2, 0.5, steps=steps),
        row("hold", "INVALID", 3, steps={**steps, "most": 99000}),
        row("hold", "CD", 4, 0.5, ecu="host", steps={**steps, "hz": 0}),
    ]
    (found,) = table(rows)["steps"]
    assert found["key"] == "ifd on mcu, 22 MHz"
    assert [found[f"{each}_us"] for each in ("mean", "sigma", "min", "max")] == [312.5, 125.0, 250.0, 500.0]


def test_of_nothing():
    """No row at all makes a document without groups."""
    found = table([])
    assert (found["n"], found["conditions"], found["fault_free"], found["steps"]) == (0, [], [], [])

"""What changed between two stores: matched trials, verdicts, kinds, times."""

import io
import random

import pytest
from rich.console import Console

from campaigns.differences import MOST, difference_tables, differences, summary
from campaigns.errors import CampaignError
from tests.campaigns.synthetic import Row, row


def both(*pairs, condition="hold"):
    """Two stores of the same trials under two ECUs; a pair: outcomes, or each (outcome, td_s, named)."""
    a, b = [], []
    for seed, pair in enumerate(pairs):
        for store, end, ecu in zip((a, b), pair, ("ifd", "ifd2"), strict=True):
            outcome, *more = [end] if isinstance(end, str) else end
            store.append(row(condition, outcome, seed, *more, ecu=ecu))
    return a, b


def test_same():
    """The same results under another ECU are no difference, though every id differs."""
    a, b = both((("CD", 0.5, "hold"), ("CD", 0.5, "hold")), ("MD", "MD"))
    assert {x.id for x in a}.isdisjoint(x.id for x in b)
    found = differences(a, b)
    assert (found["matched"], found["unchanged"], found["changed"]) == (2, 2, [])


def test_changed_verdict():
    """A changed outcome is told with both results and both ids."""
    a, b = both((("CD", 0.5, "hold"), "MD"), ("MD", "MD"))
    (change,) = differences(a, b)["changed"]
    assert (change["a"], change["b"]) == (a[0].id, b[0].id)
    assert change["what"] == ["outcome", "named"]
    assert change["outcome"] == ["CD", "MD"]
    assert change["td_s"] == [0.5, None]
    assert (change["condition"], change["lap"]["seed"], change["fault"]) == ("hold", 0, "rear_stroke:hold@60")


def test_changed_kind():
    """Another kind named is a change, though the verdict is the same."""
    (change,) = differences(*both((("CD", 0.5, "hold"), ("CD", 0.5, "open"))))["changed"]
    assert (change["what"], change["named"]) == (["named"], ["hold", "open"])


@pytest.mark.parametrize(("td_s", "changed"), [(0.51, False), (0.49, False), (0.511, True), (0.489, True)])
def test_tolerance(td_s, changed):
    """A time to detect changed if it moved by more than one control period, either way."""
    found = differences(*both((("CD", 0.5), ("CD", td_s))))
    assert [change["what"] for change in found["changed"]] == [["td_s"]] * changed
    wide = differences(*both((("CD", 0.5), ("CD", td_s))), tolerance_s=0.1)
    assert wide["changed"] == []


def test_times():
    """Of the times that moved it is counted which way, with the sign test's p."""
    pairs = [(("CD", 1.0), ("CD", 0.5))] * 6 + [(("CD", 1.0), ("CD", 1.5)), (("CD", 1.0), "MD")]
    times = differences(*both(*pairs))["times"]
    assert (times["earlier"], times["later"]) == (6, 1)
    assert times["p"] == pytest.approx(2 * (1 + 7) / 2**7)


def test_mcnemar():
    """Detections lost and won are counted where both runs are valid, with McNemar's exact p."""
    pairs = [("CD", "MD")] * 2 + [("FA", "CD")] * 8 + [("CD", "CD"), ("INVALID", "CD"), ("CD", "INVALID")]
    found = differences(*both(*pairs))["detections"]
    assert (found["n"], found["lost"], found["won"]) == (11, 2, 8)
    assert found["p"] == pytest.approx(0.109375)


def test_quiet_laps():
    """Laps without a fault are a matter of their own: alarms won and lost there are no detections."""
    found = differences(*both(("OK", "FA"), ("OK", "OK"), condition="fault-free"))
    assert found["quiet"] == {"n": 2, "lost": 1, "won": 0, "p": 1.0}
    assert found["detections"]["n"] == 0


def test_only_in_one():
    """A trial without its like in the other store is listed, not compared."""
    a, b = both(("CD", "MD"), ("MD", "CD"))
    found = differences(a[:1], b[1:])
    assert (found["matched"], found["changed"]) == (0, [])
    assert [each["id"] for each in found["only_a"]] == [a[0].id]
    assert [each["id"] for each in found["only_b"]] == [b[1].id]


@pytest.mark.parametrize("field", ["fault", "sensors_seed", "parameters", "lap", "td_max_s"])
def test_matched_on_everything_else(field):
    """Trials that differ in anything but the ECU are different trials."""
    (a,), (b,) = both(("CD", "CD"))
    other = Row(
        b.id, {**b.trial, field: {"gain": 1.2} if field in ("parameters", "lap") else "other"}, b.result
    )
    assert differences([a], [other])["matched"] == 0


def test_outcomes():
    """Which outcomes became which is counted."""
    moves = differences(*both(("CD", "MD"), ("CD", "MD"), ("MD", "MD")))["outcomes"]
    assert moves == [{"a": "CD", "b": "MD", "n": 2}, {"a": "MD", "b": "MD", "n": 1}]


def test_order_is_nothing():
    """The document does not depend on the order of the rows."""
    a, b = both(*[("CD", "MD")] * 9)
    assert differences(random.sample(a, 9), random.sample(b, 9)) == differences(a, b)


def test_two_ecus_in_a_store():
    """A store whose trials differ in their ECU alone cannot be matched."""
    a, b = both(("CD", "MD"))
    with pytest.raises(
        CampaignError, match=r"^the first store: trials \w{16} and \w{16} differ in their ECU alone"
    ):
        differences([*a, *b], b)


def test_no_road_trials():
    """Trials without verdicts are refused by name."""
    with pytest.raises(CampaignError, match="the second store: trial x is no road trial"):
        differences([], [Row("x", {"kind": "offline"}, {})])


def test_tables():
    """The terminal shows the summary, then each change; many are cut with a word on it."""
    pairs = [(("CD", 0.5, "hold"), "MD")] * (MOST + 3)
    found = differences(*both(*pairs))
    out = io.StringIO()
    for part in difference_tables(found, "a [1]", "b"):
        Console(file=out, width=150).print(part, highlight=False)
    said = out.getvalue()
    assert f"a [1] -> b: {MOST + 3} of {MOST + 3} matched trials changed" in said
    assert said.count("CD -> MD") == MOST + 1
    assert "and 3 more" in said
    assert "0.50 -> -" in said


def test_summary_of_same():
    """Nothing changed is said in the same lines."""
    a, b = both(("CD", "CD"))
    assert summary(differences(a, b), "a", "b")[0] == "a -> b: 0 of 1 matched trials changed"
    assert len(difference_tables(differences(a, b), "a", "b")) == 1

"""The offline campaign's file: valid as shipped, and refused with what is wrong in it."""

import pytest
from pydantic import ValidationError

from campaigns.offline_plan import OfflineCampaign
from campaigns.plan import load
from campaigns.thesis import thesis
from tests.campaigns.offline_laps import plan


def test_the_shipped_campaign_is_the_thesiss():
    """It asks for the thesis's cells, faults and t_max, in both feedbacks, on unseen laps."""
    shipped = load("offline")
    assert isinstance(shipped, OfflineCampaign)
    published = thesis()["offline"]
    assert shipped.L_ms == published["L_ms"]
    assert shipped.n == published["n"]
    assert (shipped.T_percent, shipped.t_max_s, shipped.faults_per_kind) == ([10.0], 120.0, 1000)
    assert set(shipped.faults) >= set(published) - {"L_ms", "n"}
    assert shipped.feedback == ["predicted", "measured"]
    assert (shipped.test.route, shipped.test.count, shipped.test.seed) == ("test_lap", 20, 30_000)


@pytest.mark.parametrize(
    ("changes", "where", "says"),
    [
        ({"L_ms": [10, 15]}, ("L_ms", 1), "multiple of 10"),
        ({"L_ms": [20, 10]}, ("L_ms",), "each value must be larger than the one before"),
        ({"n": [1, 1]}, ("n",), "each value must be larger"),
        ({"n": []}, ("n",), "at least 1 item"),
        ({"T_percent": [0]}, ("T_percent", 0), "greater than 0"),
        ({"t_max_s": float("nan")}, ("t_max_s",), "finite number"),
        ({"feedback": ["measured", "measured"]}, ("feedback",), "named twice"),
        ({"feedback": ["guessed"]}, ("feedback", 0), "'predicted' or 'measured'"),
        ({"faults": {}}, ("faults",), "at least 1 item"),
        ({"faults": {"a": "rear_stroke:broken"}}, ("faults",), "unknown kind 'broken'"),
        ({"faults": {"a": "rear_stroke:hold@5"}}, ("faults",), "which the campaign draws: leave out the @"),
        ({"faults_per_kind": 0}, ("faults_per_kind",), "greater than or equal to 1"),
        ({"t_max_ms": 120_000}, ("t_max_ms",), "[Ee]xtra"),
    ],
)
def test_what_is_no_campaign_is_refused(changes, where, says):
    """Each refusal names the place and the reason."""
    with pytest.raises(ValidationError, match=says) as caught:
        plan(**changes)
    assert caught.value.errors()[0]["loc"] == where

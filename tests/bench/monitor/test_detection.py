"""The time to detect: alarms on the listener's clock, faults in bench time."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.monitor.detection import Detection, Told

S = 1_000_000_000


def told(bench_s, *faults):
    """A reply with faults (t_active_s, t_end_s)."""
    rows = [
        {"number": k, "spec": "rear_stroke:open@1", "state": "active", "t_active_s": a, "t_end_s": e}
        for k, (a, e) in enumerate(faults)
    ]
    return Told.of({"t_s": bench_s, "faults": rows})


def test_without_a_replay():
    """Nobody tells when a fault acted: there is no time to detect."""
    assert Detection().td_s(5 * S) is None


@given(
    speed=st.floats(0.1, 10),
    offset_s=st.floats(-100, 100),
    td_s=st.floats(0.001, 30),
    polls=st.integers(1, 4),
)
def test_between_two_replies(speed, offset_s, td_s, polls):
    """An alarm between two replies is dated by them, whatever the speed and the clocks' offset."""
    detection = Detection()
    active_s = 200.0
    alarm_ns = round((active_s + td_s) / speed * S) + round((offset_s + 200) * S)

    def bench_s(t_ns):
        return (t_ns - round((offset_s + 200) * S)) / S * speed

    for k in range(-polls, polls):
        t_ns = alarm_ns + (2 * k + 1) * S // 4
        detection.told(t_ns, told(bench_s(t_ns), (active_s, None)))
    assert detection.td_s(alarm_ns) == pytest.approx(td_s, abs=1e-4)


def test_before_the_next_reply():
    """An alarm after the last reply is dated at the speed of the last two; then it is settled for good."""
    detection = Detection()
    detection.told(10 * S, told(20.0, (24.5, None)))
    detection.told(12 * S, told(24.0, (24.5, None)))
    assert detection.td_s(13 * S) == pytest.approx(1.5)
    detection.told(14 * S, told(29.0, (24.5, None)))  # the replay had run faster than that
    assert detection.td_s(13 * S) == pytest.approx(2.0)
    detection.gone()
    assert detection.faults == ()
    assert detection.td_s(13 * S) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("faults", "td_s"),
    [
        ([], None),
        ([(None, None)], None),
        ([(11.0, None)], None),
        ([(4.0, 6.0)], None),
        ([(4.0, 10.5)], 6.0),
        ([(9.0, None), (8.0, None)], 2.0),
        ([(4.0, 6.0), (9.5, None)], 0.5),
    ],
    ids=["none", "not-acted", "later", "ended", "ends-later", "first-of-two", "second"],
)
def test_which_fault(faults, td_s):
    """The first of the faults that are active when the alarm comes counts; without one there is no time."""
    detection = Detection()
    detection.told(0, told(0.0, *faults))
    detection.told(20 * S, told(20.0, *faults))
    assert detection.td_s(10 * S) == (None if td_s is None else pytest.approx(td_s))


def test_another_replay():
    """A replay whose time has gone back is another one: the old one's clock does not count."""
    detection = Detection()
    detection.told(1 * S, told(101.0))
    detection.told(2 * S, told(102.0))
    detection.told(3 * S, told(1.0, (1.5, None)))
    detection.told(5 * S, told(3.0, (1.5, None)))
    assert detection.td_s(4 * S) == pytest.approx(0.5)


@pytest.mark.parametrize(
    "reply",
    [{}, {"t_s": 1}, {"t_s": "x", "faults": []}, {"t_s": 1, "faults": [1]}, {"t_s": 1, "faults": [{}]}],
)
def test_reply_that_is_none(reply):
    """What is no reply of a replay is none."""
    assert Told.of(reply) is None

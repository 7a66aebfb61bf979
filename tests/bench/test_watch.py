"""The watch: answers, alarms and counts read off the ECU's frames."""

import pytest

from bench.codec import Codec
from bench.watch import Watch
from targets.ecu import Frame
from targets.errors import TargetError

MS = 1_000_000
CODEC = Codec()


def status(alive, alarm=0, role="IFD_STATUS", kind=0):
    values = {"predicted_mm": 1, "residual_pct": 2, "alarm": alarm, "ready": 1, "alive": alive, "step": 7}
    values["kind"] = kind
    message = CODEC.message(role)
    raw = {name: values[name] for name in message.signals}
    return Frame(message.id, CODEC.pack(role, raw)[0].tobytes())


def timing(cycles=5500, missed=0, overruns=0, alive=0):
    raw = {"step_cycles": cycles, "missed_inputs": missed, "overruns": overruns, "alive": alive}
    return Frame(0x201, CODEC.pack("IFD_TIMING", raw)[0].tobytes())


def test_each_cycle_answered():
    """An answer that echoes each cycle's count, round its wrap, leaves nothing to complain of."""
    watch = Watch(CODEC)
    for k in range(40):
        assert watch.cycle(10 * k * MS) is None
        watch.heard(status(k & 15), (10 * k + 1) * MS)
    assert watch.unanswered(400 * MS) is None
    assert (watch.cycles, watch.answered) == (40, 40)


def test_no_answer():
    """A cycle without an answer when the next is due is an overrun that names both instants."""
    watch = Watch(CODEC)
    watch.cycle(0)
    watch.heard(status(0), 1 * MS)
    watch.cycle(10 * MS)
    complaint = watch.cycle(20 * MS)
    assert complaint == "ECU overrun: no answer to cycle 1, sent at 0.01 s, by 0.02 s"


def test_answer_to_another_cycle():
    """An answer that echoes another count than the cycle's is no answer to it."""
    watch = Watch(CODEC)
    watch.cycle(0)
    watch.heard(status(5), 1 * MS)
    assert "no answer to cycle 0" in watch.unanswered(10 * MS)


def test_nothing_asked_nothing_owed():
    """Before the first cycle there is no answer to miss."""
    assert Watch(CODEC).unanswered(10 * MS) is None


def test_alarms_are_intervals():
    """The alarm's changes become intervals; frames that repeat its state do not, the last stays open."""
    watch = Watch(CODEC)
    for k, alarm in enumerate([0, 1, 1, 0, 0, 1]):
        watch.heard(status(k, alarm), k * MS)
    assert watch.alarms == [(1 * MS, 3 * MS, None), (5 * MS, None, None)]


def test_step_cycles_and_counts():
    """The timing frames give the cycles of every step and the ECU's latest counts."""
    watch = Watch(CODEC)
    watch.heard(timing(5500), 0)
    watch.heard(timing(5700, missed=2, overruns=1), MS)
    assert watch.step_cycles == [5500, 5700]
    assert (watch.missed_inputs, watch.overruns) == (2, 1)


def test_counts_of_an_earlier_run():
    """What an ECU that was on before had counted by its first answer is not held against this run."""
    watch = Watch(CODEC)
    watch.heard(timing(missed=9, overruns=4), 0)
    assert (watch.missed_inputs, watch.overruns) == (0, 0)
    watch.heard(timing(missed=10, overruns=4), MS)
    assert (watch.missed_inputs, watch.overruns) == (1, 0)


def test_other_frames_pass():
    """Frames of the logger, of the other role, and 29-bit ones of the same number are not the ECU's."""
    watch = Watch(CODEC)
    watch.cycle(0)
    for frame in (Frame(0x100, bytes(4)), status(0, role="SOFT_STROKE"), Frame(0x200, bytes(7), True)):
        watch.heard(frame, MS)
    assert watch.answered == 0
    assert watch.unanswered(10 * MS)


def test_soft_sensor():
    """The soft sensor answers in its own messages, and never with an alarm."""
    watch = Watch(CODEC, "soft_sensor")
    watch.cycle(0)
    watch.heard(status(0, role="SOFT_STROKE"), MS)
    assert watch.unanswered(10 * MS) is None
    assert watch.alarms == []


def test_short_frame():
    """An answer too short to be read is no answer; the first such is remembered with its instant."""
    watch = Watch(CODEC)
    watch.cycle(0)
    watch.heard(Frame(0x200, bytes(3)), MS)
    watch.heard(Frame(0x201, b""), 2 * MS)
    assert watch.garbled == "IFD_STATUS of 3 bytes at 0.001 s; it has 8"
    assert watch.unanswered(10 * MS)


def test_unknown_role():
    """An ECU the DBC does not know is refused with the known ones."""
    with pytest.raises(TargetError, match=r"no ECU abs; there are ifd, soft_sensor"):
        Watch(CODEC, "abs")

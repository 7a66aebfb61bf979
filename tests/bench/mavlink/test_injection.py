"""Failure injection by a ground station: who may, what is understood, and the order of the answers."""

from concurrent.futures import Executor, Future

import pytest

from bench.control import parse_command
from bench.errors import MavlinkError
from bench.faults.kinds import KINDS
from bench.mavlink.failures import TYPES
from bench.mavlink.injector import MOST_FAULTS
from bench.mavlink.link import Rights
from bench.panel import State
from tests.bench.mavlink.desk import (
    ACCEL,
    ACCEPTED,
    DELAYED,
    DENIED,
    DISTANCE,
    FAILED,
    GYRO,
    HOME,
    IN_PROGRESS,
    MS,
    OFF,
    OK,
    REJECTED,
    STUCK,
    UNSUPPORTED,
    WRONG,
    Lap,
    Station,
    results,
)

NAN = float("nan")


@pytest.fixture
def lap():
    return Lap()


def faults(lap):
    return [str(spec).partition("@")[0] for spec in lap.script.now.specs]


def test_injected_and_cleared(lap):
    """A fault is IN_PROGRESS when it is taken and ACCEPTED when it acts; so is its end."""
    lap.to(100)
    assert lap.ask(100, lap.station.long(DISTANCE, OFF, 2)) == [IN_PROGRESS]
    assert lap.acks(110) == [ACCEPTED]
    assert lap.panel.entries(110 * MS)[0].state is State.ACTIVE
    assert lap.acks(500) == []
    assert lap.ask(500, lap.station.long(DISTANCE, OK, 2)) == [IN_PROGRESS]
    assert lap.acks(510) == [ACCEPTED]
    assert lap.panel.entries(510 * MS)[0].state is State.CLEARED


@pytest.mark.parametrize(
    ("unit", "kind", "instance", "spec"),
    [
        (DISTANCE, OFF, 1, ["fork_stroke:open"]),
        (DISTANCE, STUCK, 2, ["rear_stroke:hold"]),
        (DISTANCE, WRONG, 2, ["rear_stroke:uncalibration:gain=1.1"]),
        (DISTANCE, OFF, 0, ["fork_stroke:open", "rear_stroke:open"]),
        (GYRO, STUCK, 1, ["pitch_rate:hold"]),
        (ACCEL, OFF, 1, ["acc_front:open"]),
        (ACCEL, OFF, 2, ["acc_rear:open"]),
        (ACCEL, OFF, 3, ["acc_body:open"]),
        (ACCEL, OFF, 0, ["acc_front:open", "acc_rear:open", "acc_body:open"]),
    ],
)
def test_units_and_types(lap, unit, kind, instance, spec):
    """Each unit, instance and type is the bench's sensor and kind; instance 0 is all of the unit's."""
    assert lap.ask(100, lap.station.long(unit, kind, instance)) == [IN_PROGRESS]
    assert faults(lap) == spec


@pytest.mark.parametrize(
    "words",
    [
        (DISTANCE, OFF, 3),
        (DISTANCE, OFF, -1),
        (GYRO, OFF, 2),
        (2, OFF, 1),
        (100, OFF, 1),
        (DISTANCE, 8, 2),
        (DISTANCE, 1.5, 2),
        (7.01, OFF, 2),
        (NAN, OFF, 2),
        (DISTANCE, NAN, 2),
        (DISTANCE, OFF, NAN),
        (DISTANCE, OFF, float("inf")),
        (3e38, 3e38, 3e38),
    ],
)
def test_what_there_is_not(lap, words):
    """A unit, type or instance that the bench has not, or that is no number, is UNSUPPORTED."""
    assert lap.ask(100, lap.station.long(*words)) == [UNSUPPORTED]
    assert lap.panel.entries(100 * MS) == []


def test_kind_that_the_bench_lacks(lap, monkeypatch):
    """A type whose kind this bench does not know is UNSUPPORTED."""
    monkeypatch.delitem(KINDS, TYPES["FAILURE_TYPE_DELAYED"], raising=False)
    assert lap.ask(100, lap.station.long(DISTANCE, DELAYED, 2)) == [UNSUPPORTED]


def test_sensor_that_the_lap_lacks():
    """A sensor that the lap has not is UNSUPPORTED; of all of a unit, those that it has are taken."""
    lap = Lap(names=("fork_stroke_mm", "pitch_rate_dps", "speed_kmh"))
    assert lap.ask(100, lap.station.long(DISTANCE, OFF, 2)) == [UNSUPPORTED]
    assert lap.ask(100, lap.station.long(DISTANCE, OFF, 0)) == [IN_PROGRESS]
    assert faults(lap) == ["fork_stroke:open"]


def test_other_commands(lap):
    """Any other command is UNSUPPORTED, in the name of that command."""
    lap.link.hear(lap.station.long(0, 0, 0, command=400), HOME)
    acks = [(m.command, m.result) for m, _ in lap.to(100) if m.get_type() == "COMMAND_ACK"]
    assert acks == [(400, UNSUPPORTED)]


def test_what_the_bench_can_do(lap):
    """A request for AUTOPILOT_VERSION is ACCEPTED and answered to the one who asked."""
    lap.to(10)
    lap.link.hear(lap.station.long(148, 0, 0, command=512), ("127.0.0.1", 5))
    said = lap.to(20)
    assert [m.get_type() for m, _ in said] == ["COMMAND_ACK", "AUTOPILOT_VERSION"]
    assert {to for _, to in said} == {("127.0.0.1", 5)}


@pytest.mark.parametrize(
    ("rights", "host", "result"),
    [
        (Rights(False), "127.0.0.1", DENIED),
        (Rights(True), "127.0.0.1", IN_PROGRESS),
        (Rights(True), "127.8.9.1", IN_PROGRESS),
        (Rights(True), "::1", IN_PROGRESS),
        (Rights(True), "192.168.1.7", DENIED),
        (Rights(True), "0.0.0.0", DENIED),
        (Rights(True, "192.168.1.7"), "192.168.1.7", IN_PROGRESS),
        (Rights(True, "192.168.1.7"), "192.168.1.8", DENIED),
        (Rights(True, "192.168.1.7"), "127.0.0.1", DENIED),
        (Rights(False, "192.168.1.7"), "192.168.1.7", DENIED),
    ],
)
def test_who_may_inject(rights, host, result):
    """Nobody without leave; with it this machine, or instead the one address that was given."""
    lap = Lap(rights=rights)
    assert lap.ask(100, lap.station.long(DISTANCE, OFF, 2), (host, 1)) == [result]
    assert len(lap.panel.entries(100 * MS)) == (result == IN_PROGRESS)


def test_no_address():
    """What is no IP address cannot be injected from."""
    with pytest.raises(MavlinkError, match="'garage' to inject from is no IP address"):
        Rights(True, "garage")


def test_denied_comes_before_unsupported():
    """One who may not inject does not learn what could be injected."""
    lap = Lap(rights=Rights(False))
    assert lap.ask(100, lap.station.long(DISTANCE, 8, 9)) == [DENIED]


def test_repetition_is_not_fired_twice(lap):
    """A command that is confirmed again gets the answer of the first, and fires nothing."""
    assert lap.ask(100, lap.station.long(DISTANCE, OFF, 2)) == [IN_PROGRESS]
    assert lap.ask(105, lap.station.long(DISTANCE, OFF, 2, 1))[0] == IN_PROGRESS
    lap.acks(120)
    assert lap.ask(130, lap.station.long(DISTANCE, OFF, 2, 2)) == [ACCEPTED]
    assert len(lap.panel.entries(130 * MS)) == 1


def test_confirmation_of_what_was_never_heard(lap):
    """A repetition whose first packet was lost is taken as the command that it is."""
    assert lap.ask(100, lap.station.long(DISTANCE, OFF, 2, 3)) == [IN_PROGRESS]
    assert len(lap.panel.entries(100 * MS)) == 1


def test_command_int(lap):
    """COMMAND_INT does the same; while it is under way the same again is a repetition, later it is not."""
    assert lap.ask(100, lap.station.int(DISTANCE, WRONG, 2)) == [IN_PROGRESS]
    assert lap.ask(100, lap.station.int(DISTANCE, WRONG, 2))[0] == IN_PROGRESS
    assert len(lap.panel.entries(100 * MS)) == 1
    lap.acks(110)
    assert lap.ask(120, lap.station.int(DISTANCE, WRONG, 2)) == [IN_PROGRESS]
    assert len(lap.panel.entries(120 * MS)) == 2


def test_version_1(lap):
    """A packet of MAVLink 1 is a packet."""
    assert lap.ask(100, lap.station.long(DISTANCE, OFF, 2, version_1=True)) == [IN_PROGRESS]


@pytest.mark.parametrize(("to", "heard"), [((0, 0), 1), ((1, 0), 1), ((2, 1), 0), ((1, 2), 0), ((255, 0), 0)])
def test_for_others(lap, to, heard):
    """Commands to another system or component pass unanswered; those to all are taken."""
    assert len(lap.ask(100, lap.station.long(DISTANCE, OFF, 2, to=to))) == heard
    assert len(lap.panel.entries(100 * MS)) == heard
    assert lap.link.refused == 0


def test_own_echo(lap):
    """A packet in the bench's own name is none of a ground station."""
    assert lap.ask(100, Station(1, 1).long(DISTANCE, OFF, 2)) == []


def test_answers_go_to_the_one_who_asked(lap):
    """Each answer goes to the address, system and component that its command came from."""
    lap.to(10)
    lap.link.hear(Station(7, 9).long(DISTANCE, OFF, 1), ("127.0.0.1", 7))
    lap.link.hear(Station(8, 3).long(DISTANCE, OFF, 2), ("127.0.0.1", 8))
    said = [(m.target_system, m.target_component, to[1]) for m, to in lap.to(20)]
    assert said == [(7, 9, 7), (8, 3, 8)]


def test_fault_that_changes_nothing(lap):
    """A fault that ended without having changed a sample has FAILED, before the end of both is ACCEPTED."""
    lap.ask(100, lap.station.long(DISTANCE, OFF, 2))
    lap.acks(110)
    assert lap.ask(120, lap.station.long(DISTANCE, STUCK, 2)) == [IN_PROGRESS]
    assert lap.acks(500) == []
    assert lap.ask(510, lap.station.long(DISTANCE, OK, 2)) == [IN_PROGRESS]
    assert lap.acks(520) == [FAILED, ACCEPTED]


def test_still_under_way_is_said_again(lap):
    """What takes longer is IN_PROGRESS once a second, so that nobody gives it up."""
    lap.ask(100, lap.station.long(DISTANCE, OFF, 2))
    lap.ask(110, lap.station.long(DISTANCE, STUCK, 2))
    assert [lap.acks(110 + k * 250) for k in range(9)] == [[], [], [], [], [5], [], [], [], [5]]


def test_end_of_the_lap(lap):
    """What has not acted when the lap is over has FAILED; what has is ACCEPTED."""
    lap.ask(100, lap.station.long(DISTANCE, OFF, 2))
    lap.acks(110)
    lap.ask(120, lap.station.long(DISTANCE, STUCK, 2))
    lap.ask(2980, lap.station.long(DISTANCE, OFF, 1))
    assert results(lap.read(lap.link.end(2999 * MS))) == [ACCEPTED, FAILED]
    assert lap.link.end(2999 * MS) == []


def test_too_late(lap):
    """A fault for which the lap has no time left has FAILED at once."""
    lap.to(2999)
    assert lap.ask(3000, lap.station.long(DISTANCE, OFF, 2)) == [FAILED]


def test_planned_for_later():
    """To clear a unit leaves alone what is planned for later, and ends what was planned and acts by now."""
    lap = Lap(planned=("rear_stroke:open@0.05", "rear_stroke:hold@2"))
    assert lap.ask(100, lap.station.long(DISTANCE, OK, 2)) == [IN_PROGRESS]
    assert lap.acks(110) == [ACCEPTED]
    assert [entry.state for entry in lap.panel.entries(110 * MS)] == [State.CLEARED, State.FIRED]


def test_nothing_to_clear(lap):
    """A unit without a fault is OK at once, whatever other units have."""
    lap.ask(100, lap.station.long(DISTANCE, OFF, 1))
    lap.acks(110)
    assert lap.ask(120, lap.station.long(DISTANCE, OK, 2)) == [ACCEPTED]
    assert lap.ask(130, lap.station.long(GYRO, OK, 0)) == [ACCEPTED]
    assert lap.panel.entries(130 * MS)[0].state is State.ACTIVE


class Later(Executor):
    """Does what it is given when it is told to."""

    def __init__(self):
        self.given = []

    def submit(self, work):
        self.given.append((work, Future()))
        return self.given[-1][1]

    def do(self):
        for work, future in self.given:
            future.set_result(work())
        self.given.clear()


def test_planned_beside_the_replay():
    """Where planning takes its time, clearing waits for the plan, and is asked for once."""
    planner = Later()
    lap = Lap(executor=planner)
    lap.to(100)
    assert lap.ask(100, lap.station.long(DISTANCE, OFF, 2)) == [IN_PROGRESS]
    assert lap.ask(110, lap.station.long(DISTANCE, OK, 2)) == [IN_PROGRESS]
    assert lap.acks(120) == []
    planner.do()
    assert lap.acks(130) == []
    planner.do()
    answers = [(planner.do(), lap.acks(t_ms))[1] for t_ms in range(140, 260, 10)]
    assert [one for one in answers if one] == [[ACCEPTED], [ACCEPTED]]
    spec = lap.script.now.specs[0]
    assert (spec.t_cmd_ns, spec.duration_ns) == (150 * MS, 30 * MS)


def test_so_many_faults(lap):
    """A panel that is full takes no more for the present."""
    for _ in range(MOST_FAULTS):
        lap.panel.arm(parse_command("fork_stroke:hold"))
    assert lap.ask(100, lap.station.long(DISTANCE, OFF, 2)) == [REJECTED]


def test_what_was_done_is_kept(lap):
    """Every command that was carried out is kept with its bench time, the others are counted."""
    lap.ask(100, lap.station.long(DISTANCE, OFF, 2))
    lap.ask(200, lap.station.long(DISTANCE, OFF, 9))
    lap.ask(300, lap.station.long(DISTANCE, OK, 2))
    lap.acks(310)
    kept = [(one.t_ns // MS, str(one.asked), one.numbers, one.result) for one in lap.injector.taken]
    assert kept == [(100, "rear_stroke:open", (0,), ACCEPTED), (300, "rear_stroke:ok", (0,), ACCEPTED)]
    assert dict(lap.injector.refused) == {UNSUPPORTED: 1}

"""The fault panel: states, instants, and plans that are made beside the replay."""

from concurrent.futures import Executor, Future

import numpy as np
import pytest

from bench.codec import Codec
from bench.errors import FaultError
from bench.faults.spec import parse_fault
from bench.panel import LEAD_NS, Panel, State
from bench.script import Script
from bench.sensors.codes import acquire
from tests.conftest import wavy_lap

MS = 1_000_000
CODEC = Codec()
CODES = acquire(wavy_lap(0.5))
OPEN = parse_fault("rear_stroke:open@0")


class Later(Executor):
    """Works when it is told to."""

    def __init__(self):
        self.jobs = []

    def submit(self, work, /, *args, **kwargs):
        self.jobs.append((work, Future()))
        return self.jobs[-1][1]

    def work(self):
        for work, future in self.jobs:
            try:
                future.set_result(work())
            except FaultError as error:
                future.set_exception(error)
        self.jobs = []


def sent_until(script, t_ns):
    while script.take(t_ns) is not None:
        pass


def states(panel, t_ns):
    return [entry.state for entry in panel.entries(t_ns)]


@pytest.fixture
def script():
    """A lap of half a second."""
    return Script(CODES, CODEC)


def test_fired_at_once(script):
    """In virtual time a fault acts on the next sample after what has been sent, and is the planned fault."""
    panel = Panel(script)
    sent_until(script, 100 * MS)
    panel.fire(panel.arm(OPEN), 100 * MS)
    entry = panel.entries(200 * MS)[0]
    assert (entry.state, entry.insertion.t_cmd_ns) == (State.ACTIVE, 100 * MS + 1)
    assert entry.insertion.t_active_ns == 101 * MS
    planned = Script(CODES, CODEC, [entry.spec]).now.codes.codes["rear_stroke"]
    assert np.array_equal(script.now.codes.codes["rear_stroke"], planned)


def test_life_of_a_fault(script):
    """Armed, fired, active, cleared: each from its own instant on."""
    panel = Panel(script)
    number = panel.arm(OPEN)
    assert states(panel, 0) == [State.ARMED]
    panel.fire(number, 100 * MS)
    assert [states(panel, t * MS)[0] for t in (99, 100, 300)] == [State.FIRED, State.ACTIVE, State.ACTIVE]
    panel.clear(number, 200 * MS)
    assert [states(panel, t * MS)[0] for t in (199, 200)] == [State.ACTIVE, State.CLEARED]
    codes = script.now.codes
    same = codes.codes["rear_stroke"] == CODES.codes["rear_stroke"]
    assert same[codes.t_ns >= 200 * MS].all()
    assert not same[(codes.t_ns >= 100 * MS) & (codes.t_ns < 200 * MS)].any()


def test_fault_that_changes_nothing_is_spent(script):
    """A fault that ended without having changed a sample says so."""
    panel = Panel(script)
    panel.fire(panel.arm(parse_fault("rear_stroke:uncalibration:gain=1@0+0.1")), 0)
    assert states(panel, 50 * MS) == [State.FIRED]
    assert states(panel, 100 * MS) == [State.SPENT]


def test_clearing_again_puts_nothing_off(script):
    """A fault whose end has been commanded is refused until then: asking again does not move the end."""
    later = Later()
    panel = Panel(script, later)
    panel.fire(panel.arm(OPEN), 0)
    later.work()
    panel.settle(10 * MS)
    panel.clear(0, 100 * MS)
    later.work()
    panel.settle(110 * MS)
    with pytest.raises(FaultError, match="being changed: nothing to clear"):
        panel.clear(0, 120 * MS)
    assert panel.entries(0)[0].insertion.t_end_ns == 100 * MS + LEAD_NS


def test_clearing_does_not_prolong(script):
    """A fault that ends by itself before the clearing would act keeps its end."""
    later = Later()
    panel = Panel(script, later)
    panel.fire(panel.arm(parse_fault("rear_stroke:open@0+0.12")), 0)
    later.work()
    panel.settle(10 * MS)
    panel.clear(0, 150 * MS)
    later.work()
    panel.settle(160 * MS)
    assert panel.entries(0)[0].insertion.t_end_ns == LEAD_NS + 120 * MS


def test_message_that_is_not_sent():
    """A fault of a message that this lap cannot fill is refused when it is armed."""
    panel = Panel(Script(acquire(wavy_lap(0.2, names=("fork_stroke_mm", "rear_stroke_mm"))), CODEC))
    with pytest.raises(FaultError, match="nothing is sent: the lap lacks pitch_rate_dps, speed_kmh"):
        panel.arm(parse_fault("MOTION:frame_loss@0"))


def test_planned_faults_stand_on_the_panel():
    """Faults planned beforehand come first, and can be cleared."""
    panel = Panel(Script(CODES, CODEC, [parse_fault("rear_stroke:open@0.1")]))
    assert states(panel, 50 * MS) == [State.FIRED]
    panel.clear(0, 200 * MS)
    assert states(panel, 200 * MS) == [State.CLEARED]


def test_planning_beside_the_replay(script):
    """With an executor a fault acts a lead after the request, once its plan is there and not before."""
    later = Later()
    panel = Panel(script, later)
    panel.fire(panel.arm(OPEN), 100 * MS)
    panel.settle(110 * MS)
    assert (states(panel, 110 * MS), script.now.specs) == ([State.FIRED], ())
    later.work()
    panel.settle(120 * MS)
    assert panel.entries(0)[0].insertion.t_cmd_ns == 100 * MS + LEAD_NS


def test_plan_that_came_too_late(script):
    """A plan finished after its instant has been sent is made again for a later one."""
    later = Later()
    panel = Panel(script, later)
    panel.fire(panel.arm(OPEN), 100 * MS)
    sent_until(script, 160 * MS)
    later.work()
    panel.settle(160 * MS)
    assert script.now.specs == ()
    later.work()
    panel.settle(170 * MS)
    assert panel.entries(0)[0].insertion.t_cmd_ns == 160 * MS + LEAD_NS


def test_requests_while_planning_come_next(script):
    """What is asked for while a plan is being made is in the next one, and the first is not lost."""
    later = Later()
    panel = Panel(script, later)
    first, second = panel.arm(OPEN), panel.arm(parse_fault("fork_stroke:open@0"))
    panel.fire(first, 0)
    panel.fire(second, 10 * MS)
    later.work()
    panel.settle(20 * MS)
    later.work()
    panel.settle(30 * MS)
    assert [entry.insertion.t_cmd_ns for entry in panel.entries(0)] == [LEAD_NS, 20 * MS + LEAD_NS]
    assert [str(spec) for spec in script.now.specs] == ["rear_stroke:open@0.05", "fork_stroke:open@0.07"]


def test_lap_that_ended_meanwhile(script):
    """A request whose plan would begin after the lap's end is dropped: the fault is armed as before."""
    later = Later()
    panel = Panel(script, later)
    panel.fire(panel.arm(OPEN), 400 * MS)
    sent_until(script, 490 * MS)
    later.work()
    panel.settle(490 * MS)
    later.work()
    panel.settle(500 * MS)
    assert states(panel, 500 * MS) == [State.ARMED]


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (lambda panel: panel.fire(7, 0), "no fault 7 on the panel; there are 0 to 1"),
        (lambda panel: panel.fire(0, 0), r"fault 0 \(rear_stroke:open@0\.1\) has been fired already"),
        (lambda panel: panel.clear(1, 0), r"fault 1 \(rear_stroke:open@0\) is armed: nothing to clear"),
        (lambda panel: panel.fire(1, 10**12), "too late to fire it: the lap ends at 0.499 s"),
    ],
)
def test_refused(ask, says):
    """What cannot be is refused with the fault's number."""
    panel = Panel(Script(CODES, CODEC, [parse_fault("rear_stroke:open@0.1")]))
    panel.arm(OPEN)
    with pytest.raises(FaultError, match=says):
        ask(panel)


def test_sensor_the_lap_lacks():
    """A fault of a sensor that this lap has not is refused when it is armed."""
    panel = Panel(Script(acquire(wavy_lap(0.2, names=("fork_stroke_mm", "rear_stroke_mm"))), CODEC))
    with pytest.raises(FaultError, match="the lap's sensors are fork_stroke, rear_stroke"):
        panel.arm(parse_fault("speed:open@0"))

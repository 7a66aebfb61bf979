"""The same suite in wall time: an ECU attached to a live bus, faults that are planned beside the replay."""

import sys

import pytest

from bench.errors import BusError
from bench.pytest_plugin import attached
from targets.ecus import build
from targets.host import library

ON = "host" if library() else "emulated"

UNPUNCTUAL = ("was late by", "ECU overrun", "did not keep up", "frames lost", "took too long")
"""What a run says of a machine with other work: then it proves nothing."""


def ridden(result):
    """`result`, unless the machine was too busy for real time."""
    text = result.stdout.str()
    if result.ret and any(reason in text for reason in UNPUNCTUAL):
        pytest.skip("no real time here: other work was in the way")
    return result


def test_the_same_test_in_wall_time(suite):
    """Faults planned, fired and cleared on a live bus act at the instants they got; alarms come and go."""
    result = suite(
        """
def test_it(bench, ecu, bus, faults):
    assert bench.live
    planned = faults.plan("rear_stroke:short@0.7+0.5")
    assert (bench.now, planned.t_cmd) == (0.0, 0.7)
    assert ecu.alarm.within(0.5, of=planned) if bench.ride(0.6) is None else None
    ecu.alarm.cleared.within(1.0)
    fired = faults.fire("rear_stroke:short")
    assert fired.t_cmd <= bench.now
    ecu.alarm.within(0.5, of=fired)
    fired.clear()
    assert fired.t_end <= bench.now
    assert ecu.device is None
    assert len(bus.signal("IFD_STATUS.predicted_mm").values) == bench.watch.answered
    assert bus.load > 0
""",
        "--bench-bus",
        "virtual:plugin",
        "--bench-ecu",
        ON,
    )
    ridden(result).assert_outcomes(passed=1)


def test_real_ecu_that_is_not_there(suite):
    """With --bench-ecu real nothing is started: without an ECU on the bus the ride fails and says so."""
    result = suite(
        """
def test_it(bench, ecu):
    assert ecu.build is None
    bench.ride(0.2)
""",
        "--bench-bus",
        "virtual:nobody",
        "--bench-ecu",
        "real",
    )
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["E *expected the ride to go on; seen: *"])
    result.stdout.fnmatch_lines(["*wall time; ecu ifd, real; lap lap.parquet"])


def test_step_time_of_a_real_ecu(suite):
    """The step time of an ECU whose clock nobody told is no reason to fail: the test is skipped."""
    result = suite(
        """
def test_it(ecu):
    ecu.step_time.below(1e-3)

@pytest.mark.ecu(clock_hz=22_000_000)
def test_told(ecu):
    assert ecu.fitted.hz == 22_000_000
""",
        "--bench-bus",
        "virtual:nobody",
        "--bench-ecu",
        "real",
        "-rs",
    )
    result.assert_outcomes(skipped=1, passed=1)
    result.stdout.fnmatch_lines(["*no step time: the clock of a real ECU is what @pytest.mark.ecu(clock_hz*"])


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Let a script stand in for `bench ecu`: attach it, and return what it is said to complain of."""

    def attach(script):
        path = tmp_path / "ecu.py"
        path.write_text(QUIET + script)
        plain = attached.subprocess.Popen

        def instead(command, **options):
            return plain([sys.executable, str(path)], **options)

        monkeypatch.setattr(attached.subprocess, "Popen", instead)
        complaints = []
        with attached.attached(build(), "socketcan:vcan0", 500_000, 10**7, complaints):
            pass
        return complaints

    return attach


QUIET = "import signal, sys\nsignal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])\n"
SAYS_READY = "print('ecu ifd on socketcan:vcan0, running on mcu', file=sys.stderr, flush=True)\n"


def test_ecu_in_a_process(stand_in):
    """A process that says it is ready is stopped at the end, and has nothing to complain of."""
    assert stand_in(SAYS_READY + "signal.sigwait([signal.SIGINT])") == []


def test_ecu_that_could_not_keep_up(stand_in):
    """What the ECU says about its own pace is a complaint."""
    said = "did not keep up: 3 times 10 ms or more behind"
    assert stand_in(f"{SAYS_READY}signal.sigwait([signal.SIGINT])\nprint({said!r}, file=sys.stderr)") == [
        f"ecu ifd: {said}"
    ]


def test_ecu_that_ended_early(stand_in):
    """An ECU whose bus went away under it is a complaint with its own line."""
    script = SAYS_READY + "print('bench: bus: gone', file=sys.stderr); sys.exit(2)"
    assert stand_in(script) == ["ecu ifd: bench: bus: gone"]


def test_ecu_that_crashed(stand_in):
    """An ECU that ended without a word is a complaint with its exit code."""
    assert stand_in(SAYS_READY + "signal.sigwait([signal.SIGINT])\nsys.exit(3)") == [
        "ecu ifd: ended with exit code 3"
    ]


def test_ecu_that_never_gets_ready(stand_in):
    """An ECU that ends before it was ready refuses the test in one line."""
    with pytest.raises(BusError, match=r"^ecu ifd did not get ready: bus: no such device$"):
        stand_in("print('bench: bus: no such device', file=sys.stderr); sys.exit(2)")

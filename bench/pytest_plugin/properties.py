"""What a JUnit report says of each test on the bench, beside its outcome."""

from bench.pytest_plugin.ride import Bench


def properties(bench: Bench) -> list[tuple[str, object]]:
    """Name and value of each property; what did not happen is left out."""
    verdict, step_s, replay = bench.verdict, bench.ecu.step_time.worst, bench.replay
    known: dict[str, object] = {
        "outcome": str(verdict.outcome),
        "reason": verdict.reason,
        "t_active_s": _s(verdict.t_active_ns),
        "t_alarm_s": _s(verdict.t_alarm_ns),
        "td_s": _s(verdict.td_ns),
        "worst_step_s": step_s,
        "bus_load": round(bench.load, 6),
        "time": "wall" if bench.live else "virtual",
        "worst_late_s": _s(replay.worst_late_ns) if replay else None,
        "lap": bench.lap.source,
        "lap_sha256": bench.lap.digest(),
        **bench.ecu.fitted.provenance(),
    }
    return [(f"bench.{name}", value) for name, value in known.items() if value is not None]


def _s(t_ns: int | None) -> float | None:
    return None if t_ns is None else t_ns / 1e9

"""What a test expects of the bench, and the one line that says how it was disappointed."""

from typing import NamedTuple

from bench.verdict import Verdict


class Instant(NamedTuple):
    """A moment that a report names, ns of bench time."""

    name: str
    t_ns: int


class Unmet(AssertionError):
    """An expectation that was not met. instants: those its line names, the deadline among them."""

    def __init__(self, expected: str, seen: str, instants: list[Instant]) -> None:
        named = ", ".join(f"{instant.name} {seconds(instant.t_ns)}" for instant in instants)
        super().__init__(f"expected {expected}; seen: {seen}" + (f" ({named})" if named else ""))
        self.instants = instants


def instants(verdict: Verdict, deadline_ns: int | None = None) -> list[Instant]:
    """The instants of a run that have happened, and the deadline if there was one, in the order of time."""
    named = {
        "t_cmd": verdict.t_cmd_ns,
        "t_active": verdict.t_active_ns,
        "t_obs": verdict.t_obs_ns,
        "t_alarm": verdict.t_alarm_ns,
        "t_heal": verdict.t_heal_ns,
        "deadline": deadline_ns,
    }
    return sorted((Instant(name, t) for name, t in named.items() if t is not None), key=lambda i: i.t_ns)


def seconds(t_ns: int) -> str:
    """An instant as reports show it, to the millisecond."""
    return f"{t_ns / 1e9:.3f} s"

"""Progress bars on the error stream: the result alone goes to the output."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress

    from targets.narx.settings import Settings
    from targets.narx.train import Progress as Step

REFRESH_S = 0.1


class LapBar:
    """Call it with the instant reached, ns. `say` writes a line above the bar, where somebody looks."""

    def __init__(self, bar: "Progress", duration_ns: int) -> None:
        self._bar = bar
        self._task = bar.add_task("", total=duration_ns / 1e9)
        self._drawn = 0.0

    def __call__(self, t_ns: int) -> None:
        """Draw it, now and then."""
        if time.monotonic() - self._drawn >= REFRESH_S:
            self._bar.update(self._task, completed=t_ns / 1e9, refresh=True)
            self._drawn = time.monotonic()

    def say(self, text: str) -> None:
        """One line."""
        if not self._bar.disable:
            self._bar.console.print(text, highlight=False, markup=False)


@contextmanager
def lap_progress(duration_ns: int, what: str = "riding") -> Iterator[LapBar]:
    """A bar for one ride or run, nothing where no one looks."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn(what), BarColumn(), TextColumn("{task.completed:.0f} s"), TimeRemainingColumn())
    screen = Console(stderr=True)
    # Drawn when told, not by a thread: a live replay may not be held up while it is on time.
    with Progress(
        *columns, console=screen, transient=True, auto_refresh=False, disable=not screen.is_terminal
    ) as bar:
        yield LapBar(bar, duration_ns)


@contextmanager
def counted_progress(what: str, total: int | None) -> Iterator[Callable[[str], None]]:
    """A bar of `total` jobs with the time left; yields what to call, with a word on it, as each one ends."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    # Drawn when told, not by a thread: none may be running when workers are forked.
    with Progress(
        *columns, console=screen, transient=True, auto_refresh=False, disable=not screen.is_terminal
    ) as bar:
        task = bar.add_task(what, total=total)
        bar.refresh()
        yield lambda word: bar.update(task, advance=1, description=f"{what} {word}".strip(), refresh=True)


@contextmanager
def trials_progress(total: int) -> "Iterator[Callable[[int, int, dict[str, Any]], None]]":
    """A bar of `total` trials with their rate and the time left; yields what a campaign's runner tells."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("trials"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[latest]}"),
    )
    screen = Console(stderr=True)
    begun, first = time.monotonic(), -1
    # Drawn when told, not by a thread: none may be running when workers are forked.
    with Progress(
        *columns, console=screen, transient=True, auto_refresh=False, disable=not screen.is_terminal
    ) as bar:
        task = bar.add_task("", total=total, rate="", latest="")
        bar.refresh()
        drawn = 0.0

        def tell(done: int, _: int, result: dict[str, Any]) -> None:
            nonlocal first, drawn
            first = done - 1 if first < 0 else first
            now = time.monotonic()
            if now - drawn < REFRESH_S and done < total:
                return
            rate = f"{60 * (done - first) / max(now - begun, 1e-9):.1f}/min"
            bar.update(task, completed=done, rate=rate, latest=str(result.get("outcome", "")), refresh=True)
            drawn = now

        yield tell


@contextmanager
def training_progress(settings: "Settings") -> "Iterator[Callable[[Step], None]]":
    """A bar over all seeds and stages, with the present stage and held-out error beside it."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    screening = sum(stage.iterations for stage in settings.screening)
    total = screening * len(settings.seeds) + sum(stage.iterations for stage in settings.refinement)
    screen = Console(stderr=True)
    # In a log file its last state would be a line of noise, before a refusal too.
    with Bar(*columns, console=screen, transient=True, disable=not screen.is_terminal) as bar:
        task = bar.add_task("training", total=total)
        seen: set[tuple[int, str]] = set()
        before = 0

        def tell(step: "Step") -> None:
            nonlocal before
            key = (step.seed, step.stage)
            if key not in seen:
                seen.add(key)
                before = int(bar.tasks[0].completed)
            # A stage may end before its last iteration: the bar never runs back.
            bar.update(
                task,
                completed=before + step.iteration,
                description=f"seed {step.seed}, {step.stage}: held-out {step.judge:.2f} %",
            )

        yield tell

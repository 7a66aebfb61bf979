"""Progress bars on the error stream: the result alone goes to the output."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def lap_progress(duration_ns: int) -> Iterator[Callable[[int], None]]:
    """A bar for one ride; yields what to call with the instant reached, ns."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("riding"), BarColumn(), TextColumn("{task.completed:.0f} s"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=duration_ns / 1e9)
        yield lambda t_ns: bar.update(task, completed=t_ns / 1e9)

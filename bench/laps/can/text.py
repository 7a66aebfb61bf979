"""Text logs that python-can reads, under guard: a line gives a frame, or by right gives none, or is damage.

Belongs here: what python-can's readers of .asc, .trc and .csv have in common. Never: a format's own words.
"""

from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from bench.errors import LapError
from bench.laps.can.frames import MOST_BYTES, Damage, Frames, gather, shown
from bench.quiet import quiet

if TYPE_CHECKING:
    import can

LONGEST_LINE = 10_000
"""Characters; a file without line ends is not taken for one long line."""


class Lines:
    """The lines of a text, numbered from 1: what python-can's readers iterate over instead of a file.

    number, line: what was handed out last; who has made a frame of it sets `line` to "".
    skipped: called with a line that is still there when the next one is asked for.
    """

    def __init__(self, path: Path, skipped: Callable[[int, str], None]) -> None:
        if path.stat().st_size > MOST_BYTES:
            raise LapError(f"{path}: longer than {MOST_BYTES} bytes: cut it to the lap")
        self.where = str(path)
        self.skipped = skipped
        self.number, self.line = 0, ""
        self._read = 0
        self._again: deque[tuple[int, str]] = deque()
        self._file = path.open(encoding="utf-8-sig", errors="replace", newline="\n")

    def __enter__(self) -> "Lines":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def __iter__(self) -> "Lines":
        return self

    def __next__(self) -> str:
        if self.line:
            self.skipped(self.number, self.line)
        self.line = ""
        self.number, text = self._again.popleft() if self._again else self._next()
        self.line = "" if text.isspace() and text.endswith("\n") else text
        return text

    def _next(self) -> tuple[int, str]:
        """The next line of the file that is not blank, and its number."""
        while True:
            line = self._file.readline(LONGEST_LINE)
            if not line:
                raise StopIteration
            self._read += 1
            if len(line) >= LONGEST_LINE:
                raise LapError(f"{self.where}: line {self._read} is longer than any: {shown(line)}")
            if not line.isspace() or not line.endswith("\n"):
                return self._read, line

    def back(self, lines: list[tuple[int, str]]) -> None:
        """Hand `lines` out again, before the rest."""
        self._again.extendleft(reversed(lines))
        self.line = ""

    def close(self) -> None:
        """Do nothing: python-can closes what it reads, also what it is to go on with."""


def read(
    path: Path,
    reader: Callable[[Lines], "can.io.generic.MessageReader"],
    silent: Callable[[str], bool],
    shift: int = 0,
    tail: Callable[[], tuple[str, ...]] = tuple,
) -> Frames:
    """The frames of a text log through python-can's `reader`.

    silent: whether a line gives no frame by right. shift: as in `gather`. tail: damage found beside,
    asked for at the end.
    Raises LapError naming the line if the first is damaged or more than one in a hundred.
    """
    damage = Damage(str(path))
    good = 0
    cut: list[str] = []

    def wrong(at: int, line: str, why: str = "gives no frame") -> None:
        if not line.endswith("\n"):
            maybe = "possibly " if silent(line) else ""
            cut.append(f"line {at}: {maybe}cut short, it does not end: {shown(line)}")
        elif not silent(line):
            damage.add(at, f"{why}: {shown(line.strip())}", good)

    def messages(lines: Lines) -> "Iterator[tuple[int, can.Message]]":
        nonlocal good
        source = reader(lines)
        while True:
            try:
                for message in source:
                    # PEAK's logs end so; a byte that has lost a digit would be another byte
                    if not lines.line.endswith("\n") and len(lines.line.split()[-1]) < 2:
                        cut.append(f"line {lines.number}: possibly cut short, it does not end")
                    lines.line = ""
                    yield lines.number, message
                    good += 1
                return
            except LapError:
                raise
            except Exception as error:  # whatever python-can's parsing stumbled over
                reason = " ".join(str(error).split()) or type(error).__name__
                if not lines.line:
                    raise LapError(f"{path}: line {lines.number}: {reason}") from None
                wrong(lines.number, lines.line, reason)
                # each reader swallows one line where it begins
                lines.back([(lines.number, "\n")])

    with Lines(path, wrong) as lines, quiet("can"):  # what it warns of is counted here
        return gather(messages(lines), damage, shift, lambda: (*cut, *tail()))

"""Tries mutants: compiles each into a library, and asks the decision maker's tests about it.

A mutant is tried in a process of its own, since it may crash or never return. The tests are those of
tests/targets/firmware/test_decision.py; they were imported, and their rides worked out, before the fork.
"""

import faulthandler
import os
import resource
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Literal

from targets.firmware import HERE
from tests.mutation.mutants import Mutant, mutants
from tests.targets.firmware import test_decision
from tests.targets.firmware.maker import Maker
from tests.targets.firmware.sanitized import TESTS

CORE = HERE / "core"
FILES = ("residual.c", "checks.c", "ifd.c")
"""The decision maker."""

FLAGS = ("-std=c99", "-ffp-contract=off", f"-I{CORE}", f"-I{TESTS}", "-fPIC", "-w")
TRAPS = (
    "-fsanitize=undefined,float-divide-by-zero,float-cast-overflow",
    "-fsanitize-undefined-trap-on-error",
)
"""Undefined behaviour is noticed, as it is by the sanitizers' own tests: here it ends the process."""

CPU_SECONDS = 5
"""What the tests of one mutant may take; those of the original take 0.2."""

Fate = Literal["stillborn", "killed", "timed out", "same code", "survived"]


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant; `by`: the test that noticed, or the signal that ended it."""

    mutant: Mutant
    fate: Fate
    by: str = ""


def all_mutants() -> list[Mutant]:
    """Every mutant of the decision maker."""
    return [mutant for file in FILES for mutant in mutants(file, (CORE / file).read_text(encoding="utf-8"))]


@contextmanager
def workshop() -> Iterator["Workshop"]:
    """A folder with the parts of the decision maker, compiled; the original must pass its tests.

    Raises AssertionError, naming the test, if it does not.
    """
    with tempfile.TemporaryDirectory() as folder:
        shop = Workshop(Path(folder))
        # Here, not in a fork: the tests' rides are worked out once, and every fork has them.
        if failed := run(shop.link("original", CORE / FILES[0], FILES[0])):
            raise AssertionError(f"the decision maker itself does not pass {failed}")
        yield shop


class Workshop:
    """Compiles mutants in `folder`, one file of each anew."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.compiler = shutil.which("gcc") or "gcc"
        for source in (*(CORE / file for file in FILES), TESTS / "decide.c"):
            self._compile("-O0", *TRAPS, "-c", str(source), "-o", str(self._object(source.name)))

    def try_out(self, mutant: Mutant) -> Outcome:
        """Compile it and run the tests."""
        source = self.folder / mutant.name / mutant.file
        source.parent.mkdir()
        source.write_text(mutant.mutated, encoding="utf-8")
        try:
            library = self.link(mutant.name, source, mutant.file)
        except subprocess.CalledProcessError:
            return Outcome(mutant, "stillborn")
        fate, by = ask(partial(run, library))
        if fate == "survived" and self._assembly(source) == self._assembly(CORE / mutant.file):
            fate = "same code"
        shutil.rmtree(source.parent)
        return Outcome(mutant, fate, by)

    def link(self, name: str, source: Path, file: str) -> Path:
        """The library in which `source` stands for `file`."""
        others = [str(self._object(other)) for other in (*FILES, "decide.c") if other != file]
        library = self.folder / f"{name}.so"
        self._compile("-O0", *TRAPS, "-shared", "-Wl,-z,defs", str(source), *others, "-o", str(library))
        return library

    def _object(self, file: str) -> Path:
        return self.folder / f"{file}.o"

    def _compile(self, *words: str) -> str:
        command = [self.compiler, *FLAGS, *words]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    def _assembly(self, source: Path) -> str:
        """What an optimising compiler makes of it: the same for both proves them equivalent."""
        text = self._compile("-O2", "-S", "-fno-ident", str(source), "-o", "-")
        return "\n".join(line for line in text.splitlines() if not line.startswith("\t.file"))


def run(library: Path) -> str:
    """Run the decision maker's tests on the library; the name of the first that fails, '' for none."""
    decide = Maker(library).decide
    for name, test in vars(test_decision).items():
        if name.startswith("test_"):
            try:
                test(decide)
            except Exception:
                return name
    return ""


def ask(question: Callable[[], str]) -> tuple[Fate, str]:
    """Answer `question` in a process of its own, with a limit of CPU time: the fate, and what decided it."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            faulthandler.disable()
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # a crash's last words
            os.write(writer, b"." + question().encode())
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        answer = pipe.read().decode()
    _, status = os.waitpid(child, 0)
    if answer:
        return ("killed", answer[1:]) if answer[1:] else ("survived", "")
    if not os.WIFSIGNALED(status):
        raise RuntimeError(f"a trial ended without an answer, status {status}")
    ended = signal.Signals(os.WTERMSIG(status))
    # The soft and the hard limit of CPU time are the same: the kernel sends either signal.
    return "timed out" if ended in (signal.SIGXCPU, signal.SIGKILL) else "killed", ended.name


def try_all(chosen: Iterable[Mutant], workers: int) -> Iterator[Outcome]:
    """What becomes of each of the mutants, in their order."""
    with workshop() as shop, ProcessPoolExecutor(workers, get_context("fork")) as pool:
        yield from pool.map(shop.try_out, chosen, chunksize=4)

"""Trials of mutants: a sample that must die, how each fate comes about, and the list of those that cannot."""

import os
import random
import shutil
import signal

import pytest

from tests.mutation.__main__ import table
from tests.mutation.equivalent import Equivalents
from tests.mutation.mutants import Mutant
from tests.mutation.trial import CORE, Outcome, all_mutants, ask, workshop

SAMPLE, SEED = 20, 1
LISTED = Equivalents.load()


@pytest.fixture(scope="module")
def shop():
    if shutil.which("gcc") is None:
        pytest.skip("no gcc on this machine")
    with workshop() as found:
        yield found


def test_a_sample_dies(shop):
    """Of twenty mutants, always the same, each that compiles is noticed or known to be no change."""
    outcomes = [shop.try_out(mutant) for mutant in random.Random(SEED).sample(all_mutants(), SAMPLE)]
    alive = [outcome.mutant.change for outcome in outcomes if outcome.fate == "survived"]
    assert [change for change in alive if change not in LISTED.changes.values()] == []
    assert sum(outcome.fate == "killed" for outcome in outcomes) >= SAMPLE / 2


def changed(file, old, new):
    """The mutant of a core's file in which `new` stands for `old`."""
    source = (CORE / file).read_text(encoding="utf-8")
    begin = source.index(old)
    return Mutant(file, source, begin, begin + len(old), new, "by hand")


@pytest.mark.parametrize(
    ("old", "new", "fate"),
    [
        ("v.ready = 1;", "v.ready = 0;", "killed"),
        ("v.ready = 1;", "v.ready = 1 +;", "stillborn"),
        ("v.ready = 1;", "v.ready = absent(1);", "stillborn"),
        ("v.ready = 1;", "for (;;) v.ready = 1;", "timed out"),
        ("v.ready = 1;", "*(volatile int *)0 = 1;", "killed"),
        ("v.ready = 1;", "v.ready = 2 - 1;", "same code"),
        ("v.ready = 1;", "static volatile int i; v.ready = 1 + 0 * i;", "survived"),
    ],
)
def test_fates(shop, monkeypatch, old, new, fate):
    """A change ends as the compiler, the tests, the clock and the optimiser say."""
    monkeypatch.setattr("tests.mutation.trial.CPU_SECONDS", 1)
    assert shop.try_out(changed("ifd.c", old, new)).fate == fate


def test_whose_hand_it_was():
    """The test that noticed is named, or the signal that ended the trial."""
    assert ask(lambda: "test_some") == ("killed", "test_some")
    assert ask(lambda: "") == ("survived", "")
    assert ask(lambda: os.kill(os.getpid(), signal.SIGSEGV)) == ("killed", "SIGSEGV")
    with pytest.raises(RuntimeError, match="without an answer"):
        ask(lambda: 1 / 0)


def test_list_names_mutants():
    """Every listed mutant is one, is the change that it is said to be, and has a reason."""
    alive = [Outcome(mutant, "survived") for mutant in all_mutants()]
    assert LISTED.wrong(alive) == []
    assert all(LISTED.reasons.values())


def test_wrong_list(tmp_path):
    """An entry that is no mutant, another change, or noticed by a test is named."""
    one, two = all_mutants()[:2]
    path = tmp_path / "list.toml"
    path.write_text(
        f'[a]\nreason = "r"\n[a.mutants]\n00000000 = "gone"\n{one.name} = "x"\n{two.name} = {two.change!r}\n'
    )
    listed = Equivalents.load(path)
    outcomes = [Outcome(one, "survived"), Outcome(two, "killed")]
    assert listed.wrong(outcomes) == [
        "00000000 is no mutant: gone",
        f"{one.name} is another change: {one.change}",
        f"{two.name} is killed: {two.change}",
    ]


def test_table():
    """The table counts each fate by file, and what was noticed of all and of those that could be."""
    mutants = [mutant for mutant in all_mutants() if mutant.file == "residual.c"][:8]
    fates = ("killed", "killed", "killed", "timed out", "same code", "stillborn", "survived", "survived")
    listed = Equivalents({mutants[7].name: mutants[7].change}, {mutants[7].name: "why"})
    outcomes = [Outcome(mutant, fate) for mutant, fate in zip(mutants, fates, strict=True)]
    row = table(outcomes, listed).splitlines()[1].split()
    assert row == ["residual.c", "7", "3", "1", "1", "1", "1", "57.1", "80.0"]

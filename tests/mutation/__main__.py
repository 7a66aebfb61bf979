"""python -m tests.mutation: every mutant of the decision maker, and which of them its tests let live."""

import argparse
import json
import os
from collections import Counter
from pathlib import Path

from tests.mutation.equivalent import Equivalents
from tests.mutation.trial import FILES, Outcome, all_mutants, try_all

COLUMNS = ("mutants", "killed", "timed out", "same code", "listed", "survived", "raw %", "%")


def table(outcomes: list[Outcome], listed: Equivalents) -> str:
    """A row for each file and one for all: counts, and per cent killed of all and of the non-equivalent."""
    lines = ["".join(f"{name:>11}" for name in ("", *COLUMNS))]
    for file in (*FILES, "all"):
        mine = [outcome for outcome in outcomes if file in ("all", outcome.mutant.file)]
        fates = Counter("listed" if listed.explains(outcome) else outcome.fate for outcome in mine)
        total = fates.total() - fates["stillborn"]
        dead = fates["killed"] + fates["timed out"]
        equal = fates["same code"] + fates["listed"]
        counts = (total, *(fates[name] for name in COLUMNS[1:6]))
        rates = (100 * dead / max(1, total), 100 * dead / max(1, total - equal))
        lines.append(
            f"{file:>11}" + "".join(f"{n:>11}" for n in counts) + "".join(f"{r:>11.1f}" for r in rates)
        )
    return "\n".join(lines)


def main() -> int:
    """Try them all, print the table and the survivors; 1 if any survived or the list is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--json", type=Path, metavar="OUT", help="every mutant and what became of it")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="mutants by name")
    options = parser.parse_args()
    listed = Equivalents.load()
    chosen = [mutant for mutant in all_mutants() if not options.only or mutant.name in options.only]
    outcomes = list(try_all(chosen, options.workers))
    print(table(outcomes, listed))
    print(
        f"{sum(outcome.fate == 'stillborn' for outcome in outcomes)} more do not compile and are not counted."
    )
    alive = [outcome for outcome in outcomes if outcome.fate == "survived" and not listed.explains(outcome)]
    for outcome in alive:
        mutant = outcome.mutant
        print(f"survived: {mutant.name}  {mutant.file}:{mutant.line}  {mutant.change}")
    wrong = [] if options.only else listed.wrong(outcomes)
    for line in wrong:
        print(f"equivalent.toml: {line}")
    if options.json:
        options.json.write_text(
            json.dumps([document(outcome, listed) for outcome in outcomes], indent=1) + "\n"
        )
    return 1 if alive or wrong else 0


def document(outcome: Outcome, listed: Equivalents) -> dict[str, str | int]:
    """An outcome as plain data."""
    mutant = outcome.mutant
    return {
        "name": mutant.name,
        "file": mutant.file,
        "line": mutant.line,
        "operator": mutant.operator,
        "change": mutant.change,
        "fate": outcome.fate,
        "by": outcome.by,
        "reason": listed.reasons.get(mutant.name, ""),
    }


if __name__ == "__main__":
    raise SystemExit(main())

"""The list of mutants that no test can notice, each with its reason, and whether the list is right."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from tests.mutation.trial import Outcome

PATH = Path(__file__).with_name("equivalent.toml")


@dataclass(frozen=True)
class Equivalents:
    """Mutants by name: the change each is, and why nothing the decision maker says depends on it."""

    changes: dict[str, str]
    reasons: dict[str, str]

    @classmethod
    def load(cls, path: Path = PATH) -> "Equivalents":
        """The list in the file."""
        entries = tomllib.loads(path.read_text(encoding="utf-8"))
        reasons = {name: group["reason"] for group in entries.values() for name in group["mutants"]}
        changes = {name: text for group in entries.values() for name, text in group["mutants"].items()}
        return cls(changes, reasons)

    def explains(self, outcome: Outcome) -> bool:
        """Whether the mutant survived and the list says why."""
        return outcome.fate == "survived" and outcome.mutant.name in self.reasons

    def wrong(self, outcomes: list[Outcome]) -> list[str]:
        """What is wrong with the list, given what became of all mutants: a line for each entry."""
        found = {outcome.mutant.name: outcome for outcome in outcomes}
        lines = []
        for name, change in self.changes.items():
            if name not in found:
                lines.append(f"{name} is no mutant: {change}")
            elif found[name].mutant.change != change:
                lines.append(f"{name} is another change: {found[name].mutant.change}")
            elif found[name].fate != "survived":
                lines.append(f"{name} is {found[name].fate}: {change}")
        return lines

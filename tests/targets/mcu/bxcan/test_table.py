"""docs/bxcan.md names tests that exist."""

import re
from pathlib import Path

HERE = Path(__file__).parent
TABLE = Path(__file__).parents[4] / "docs" / "bxcan.md"


def test_every_behaviour_has_its_test():
    """Each test that the table names is defined beside this file, and no row names none."""
    rows = [line for line in TABLE.read_text().splitlines() if line.startswith("| ")][1:]
    named = [re.findall(r"`(test_\w+)`", row) for row in rows]
    assert len(rows) > 40
    assert all(named)
    source = "".join(path.read_text() for path in HERE.glob("test_*.py"))
    defined = set(re.findall(r"^def (test_\w+)\(", source, re.MULTILINE))
    assert {name for row in named for name in row} - defined == set()

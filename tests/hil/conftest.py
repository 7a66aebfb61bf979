"""The `bench` command called within this process."""

import sys
from typing import NamedTuple

import pytest

from bench.cli.main import main


class Said(NamedTuple):
    """Exit code, and what was written to each stream."""

    code: int
    out: str
    err: str


@pytest.fixture
def command(monkeypatch, capsys):
    """Call `bench WORD...`; a traceback is an exception that leaves this."""

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["bench", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        return Said(end.value.code or 0, *capsys.readouterr())

    return call

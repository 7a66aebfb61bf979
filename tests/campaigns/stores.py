"""A store of a few trials for the tests, and ways to spoil it."""

import os
import sqlite3
import subprocess
import sys
from contextlib import closing, contextmanager

import pytest

from campaigns.errors import CampaignError
from campaigns.store import Store, trial_id

CAMPAIGN = {"name": "road", "plan": {"laps": 3, "faults": ["open", "short"]}, "versions": {"numpy": "2.0"}}
TRIALS = [{"kind": "road", "n": n, "lap": {"route": "über\nLand"}} for n in range(5)]


def result(n):
    return {"outcome": "CD", "squares": 10**30 + n, "bus_load": 0.1 + n}


def frame(n):
    return {"t0_ns": n, "measured_mm": [0.1 * k for k in range(50)]} if n % 2 else None


def fill(store, numbers=range(5)):
    for n in numbers:
        store.put(trial_id(TRIALS[n]), TRIALS[n], result(n), frame(n))


def edit(path, *statements):
    with closing(sqlite3.connect(path)) as connection, connection:
        for statement, *values in statements:
            connection.execute(statement, values)


def refused(path, campaign=CAMPAIGN, read=False):
    """The one line with which it is not opened; nothing beside it, and nothing in it, changes."""
    before = {file: file.read_bytes() for file in path.parent.iterdir() if file.is_file()}
    with pytest.raises(CampaignError) as refusal:
        (Store.read(path) if read else Store.open(path, campaign)).close()
    assert {file: file.read_bytes() for file in path.parent.iterdir() if file.is_file()} == before
    line = str(refusal.value)
    assert line.startswith(f"{path}: ")
    assert "\n" not in line
    return line.removeprefix(f"{path}: ")


@contextmanager
def another_than_root():
    """Root may write everything: become another user."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@contextmanager
def readable_only(folder):
    """As somebody who may write nothing in `folder`."""
    folder.chmod(0o555)
    for file in folder.iterdir():
        file.chmod(0o444)
    try:
        with another_than_root():
            yield
    finally:
        folder.chmod(0o755)


def kill_while_writing(path):
    """Leave a store as kill -9 leaves it: a log beside it, with all trials in it."""
    script = (
        "import os, sys; from pathlib import Path; from tests.campaigns.stores import *\n"
        "store = Store.open(Path(sys.argv[1]), CAMPAIGN); fill(store); os.kill(os.getpid(), 9)"
    )
    assert subprocess.run([sys.executable, "-c", script, str(path)], check=False).returncode == -9

"""Stores that several tests begin with."""

import pytest

from campaigns.store import Store
from tests.campaigns.stores import CAMPAIGN, fill


@pytest.fixture
def path(tmp_path):
    """Of a store that is yet to be made."""
    return tmp_path / "a store?.db"


@pytest.fixture
def filled(path):
    """The path of a store with a few trials in it."""
    with Store.open(path, CAMPAIGN) as store:
        fill(store)
    return path

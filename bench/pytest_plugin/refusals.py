"""Bad input of a test, as a suite shows it: one line, no traceback through the bench."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from bench.errors import BenchError
from targets.errors import TargetError


@contextmanager
def refusing() -> Iterator[None]:
    """Within the block an error of bench or target fails the test with its one line."""
    try:
        yield
    except (BenchError, TargetError) as error:
        pytest.fail(f"{error.side}: {error}", pytrace=False)


def arguments(item: pytest.Item, name: str, known: dict[str, object], first: str) -> dict[str, object]:
    """The arguments of `item`'s marker `name`, over the defaults `known`; `first` may go without its name.

    Fails the test for an argument that the marker does not have.
    """
    marker = item.get_closest_marker(name)
    if marker is None:
        return known
    given = dict(marker.kwargs)
    if len(marker.args) > 1 or (marker.args and first in given):
        pytest.fail(f"marker {name}: takes one plain argument, {first}; it has {marker.args}", pytrace=False)
    if marker.args:
        given[first] = marker.args[0]
    for key in given:
        if key not in known:
            pytest.fail(f"marker {name}: no argument {key}; it takes {', '.join(known)}", pytrace=False)
    return known | given

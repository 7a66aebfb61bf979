"""What was meant by a name that nobody knows."""

import pytest

from bench.nearest import unknown


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("appel", "unknown fruit 'appel'; did you mean apple? The known ones are apple, quince"),
        ("qui", "unknown fruit 'qui'; did you mean quince? The known ones are apple, quince"),
        ("kiwi", "unknown fruit 'kiwi'; the known ones are apple, quince"),
        ("", "unknown fruit ''; the known ones are apple, quince"),
        ("a\n", "unknown fruit 'a\\n'; the known ones are apple, quince"),
    ],
)
def test_unknown(name, says):
    """The refusal names the nearest known name, if one is near, and all known ones."""
    assert unknown("fruit", name, ("apple", "quince")) == says

"""What was probably meant by a name that nobody knows."""

from collections.abc import Iterable
from difflib import get_close_matches


def unknown(what: str, name: str, known: Iterable[str]) -> str:
    """The line that refuses `name` as a `what`: the nearest of the `known` ones if one is near, then all."""
    names = list(known)
    begins = [each for each in names if name and each.startswith(name)]
    near = begins or get_close_matches(name[:100], names, 1)
    hint = f"did you mean {near[0]}? The" if near else "the"
    return f"unknown {what} {name!r}; {hint} known ones are {', '.join(names)}"

"""Numbers in a fault's written form: seconds to the nanosecond, decimals, and back.

Belongs here: one spelling for each value. Never: what a number means.
"""

import re

from bench.errors import FaultError

_SECONDS = re.compile(r"([0-9]{1,9})(?:\.([0-9]{1,9}))?")
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


def nanoseconds(text: str, what: str, spec: str) -> int:
    """Seconds written as a plain decimal, in ns; FaultError naming `what` in `spec` for anything else."""
    match = _SECONDS.fullmatch(text)
    if not match:
        raise FaultError(
            f"{what} {text!r} in {spec!r} is not a non-negative plain decimal in seconds, to the nanosecond"
        )
    whole, fraction = match.groups()
    return int(whole) * 1_000_000_000 + int((fraction or "").ljust(9, "0"))


def seconds(ns: int) -> str:
    """Nanoseconds as a plain decimal in seconds."""
    whole, fraction = divmod(ns, 1_000_000_000)
    return f"{whole}.{fraction:09d}".rstrip("0").rstrip(".")


def is_number(text: str) -> bool:
    """Whether `text` is a number as a parameter may be written."""
    return _NUMBER.fullmatch(text) is not None


def value(number: float | str) -> str:
    """A parameter's value: the fewest digits that read back as the same float."""
    return number if isinstance(number, str) else repr(number).removesuffix(".0")

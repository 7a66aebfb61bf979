"""Failure type bytes of SAE J2012-DA: the third byte of a trouble code, which says how a thing fails.

Belongs here: the bytes the catalogue uses, each with its text. Never: which kind has which.

FIDELITY: the digital annex is sold, and was not read. The texts are those of public tables of scan tools
that quote it; `sure` is False where such tables differ or only one has the byte. Which byte belongs to which
kind is this bench's own reading.
"""

from typing import NamedTuple


class FailureType(NamedTuple):
    """The text of a failure type byte, and whether independent public tables agree on it."""

    text: str
    sure: bool = True


FTB: dict[int, FailureType] = {
    0x11: FailureType("circuit short to ground"),
    0x12: FailureType("circuit short to battery"),
    0x13: FailureType("circuit open"),
    0x1A: FailureType("circuit resistance below threshold"),
    0x1B: FailureType("circuit resistance above threshold"),
    0x1F: FailureType("circuit intermittent"),
    0x26: FailureType("signal rate of change below threshold"),
    0x27: FailureType("signal rate of change above threshold"),
    0x28: FailureType("signal bias level out of range / zero adjustment failure"),
    0x2A: FailureType("signal stuck in range", sure=False),
    0x2B: FailureType("signal cross coupled"),
    0x2F: FailureType("signal erratic"),
    0x62: FailureType("signal compare failure"),
    0x81: FailureType("invalid serial data received"),
    0x82: FailureType("alive / sequence counter incorrect / not updated"),
    0x87: FailureType("missing message"),
    0x88: FailureType("bus off"),
}
"""Byte -> failure type."""

"""The header of an OpenCRG file: sections of text before the data.

Belongs here: keys, channels and what they promise of the data. Never: the data.
"""

import re
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import RouteError

MOST_LINES = 50_000
BINARY = {"KRBI": ">f4", "KDBI": ">f8"}
TEXT = {"LRFI": 10, "LDFI": 20}
"""Formats of the data: numpy's name of a number, and the characters a number takes."""

_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eEdD][+-]?\d+)?", re.ASCII)
_SECTION = re.compile(r"long section\s+(?:at v\s*=\s*(?P<v>\S+)|(?P<index>\d{1,6}))", re.IGNORECASE)


class Channel(NamedTuple):
    """One number of every row, and the line that defines it."""

    name: str
    unit: str
    line: int


@dataclass
class Header:
    """What stands before the data: values by key, the channels in order, and where the data begins."""

    road: dict[str, float] = field(default_factory=dict)
    modifiers: dict[str, float] | None = None
    channels: list[Channel] = field(default_factory=list)
    layout: str = "KRBI"  # the standard's default
    line: int = 0  # the last one read
    data_at: int = 0


def read_header(content: bytes) -> Header:
    """What stands before the data. Raises RouteError naming the line at fault."""
    header, section, at = Header(), "", 0
    while True:
        end = content.find(b"\n", at)
        header.line += 1
        if end < 0 or header.line > MOST_LINES:
            raise RouteError(f"line {header.line}: no data ($$$$) so far")
        text = content[at : min(end, at + 200)].decode("latin-1").rstrip()
        at = end + 1
        if text.startswith("$$$$"):
            header.data_at = at
            return header
        if text.startswith("$"):
            section = text[1:].split("!")[0].strip().upper()
            if section == "ROAD_CRG_FILE":
                raise RouteError(f"line {header.line}: refers to other files, which are not followed")
            if section == "ROAD_CRG_MODS":
                header.modifiers = {}
        elif section != "CT" and not text.lstrip().startswith("*"):
            _entry(header, section, text.split("!")[0].strip())


def _entry(header: Header, section: str, text: str) -> None:
    """Take one line of a section."""
    if section == "KD_DEFINITION" and text.startswith("D:"):
        name, _, unit = text[2:].rpartition(",")
        header.channels.append(Channel(" ".join(name.lower().split()), unit.strip(), header.line))
    elif section == "KD_DEFINITION" and text.startswith("#:"):
        header.layout = text[2:6].upper()
        if header.layout not in {*BINARY, *TEXT}:
            raise RouteError(f"line {header.line}: unknown format {text[2:12]!r}")
    elif section in {"ROAD_CRG", "ROAD_CRG_MODS"} and "=" in text:
        key, _, value = text.partition("=")
        values = header.road if section == "ROAD_CRG" else header.modifiers
        assert values is not None  # the section's first line made it
        values[key.strip().lower()] = number(value.strip(), f"line {header.line}: {key.strip()}")


def number(text: str, where: str) -> float:
    """The number a text is; RouteError that opens with `where` if it is none."""
    if not _NUMBER.fullmatch(text):
        raise RouteError(f"{where} is {text[:40]!r}, not a number")
    value = float(text.lower().replace("d", "e"))
    if not abs(value) < 1e12:
        raise RouteError(f"{where} is {text[:40]}, too large")
    return value


def long_sections(header: Header) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Which channels hold heights, from right to left, and at which places across the road, in metres.

    Raises RouteError where they are fewer than two, not in metres, or in no order.
    """
    found: list[tuple[float, int]] = []
    numbered: set[bool] = set()
    for column, channel in enumerate(header.channels):
        match = _SECTION.match(channel.name)
        if not match:
            continue
        where = f"line {channel.line}: {channel.name[:40]}"
        if channel.unit != "m":
            raise RouteError(f"{where} is in {channel.unit[:10]!r}, not in m")
        numbered.add(match["v"] is None)
        place = float(match["index"]) if match["v"] is None else number(match["v"], where)
        found.append((place, column))
    if len(found) < 2 or len(numbered) != 1:
        raise RouteError(f"line {header.line}: {len(found)} long sections; a road takes two, of one kind")
    found.sort()
    v, columns = np.array([place for place, _ in found]), np.array([column for _, column in found])
    if numbered == {True}:
        if not np.array_equal(v, np.arange(1.0, len(v) + 1.0)):
            raise RouteError(f"line {header.line}: long sections are not numbered from 1 without a gap")
        v = _places(header, len(v))
    if not np.all(np.diff(v) > 1e-6):
        raise RouteError(f"line {header.line}: two long sections at one v")
    return columns, v


def _places(header: Header, count: int) -> NDArray[np.float64]:
    """Where numbered long sections are: from edges and increment; symmetric with the increment alone."""
    road = header.road
    right, left = road.get("long_section_v_right"), road.get("long_section_v_left")
    step = road.get("long_section_v_increment")
    if step is None:
        if right is None or left is None:
            raise RouteError(f"line {header.line}: no long_section_v_... says where the long sections are")
        step = (left - right) / (count - 1)
    if right is None:
        right = -0.5 * (count - 1) * step if left is None else left - (count - 1) * step
    if left is not None and abs(right + (count - 1) * step - left) > 0.5 * abs(step):
        raise RouteError(
            f"line {header.line}: {count} long sections every {step:g} m are not those from {right:g} "
            f"to {left:g} m"
        )
    return right + step * np.arange(count, dtype=np.float64)


def promised_rows(header: Header) -> int | None:
    """Rows of data the header promises, if it does. RouteError where length and increment do not agree."""
    road = header.road
    if "reference_line_end_u" not in road:
        return None
    length = road["reference_line_end_u"] - road.get("reference_line_start_u", 0.0)
    steps = length / road["reference_line_increment"]
    if steps < 1 or abs(steps - round(steps)) > 0.1:
        raise RouteError(
            f"line {header.line}: {length:g} m of reference line is no whole number of steps of "
            f"{road['reference_line_increment']:g} m"
        )
    return round(steps) + 1

"""CAN logs for tests: the strokes of a short ride, as python-can's own writers put them into a file."""

import gzip
import logging
from importlib.util import find_spec

import can
import numpy as np
import pytest

from bench.codec import Codec

FORMATS = [".log", ".asc", ".blf", ".csv", ".db", ".trc"]
MDF = pytest.param(
    ".mf4", marks=pytest.mark.skipif(find_spec("asammdf") is None, reason="asammdf is not installed")
)
EVERY = [*FORMATS, MDF]

DBC = 'VERSION ""\nNS_ :\nBS_:\nBU_: NODE\n'

FRAMES = 50
STROKE_RAW = np.arange(FRAMES) * 7
REAR_RAW = 4095 - np.arange(FRAMES) * 11


def strokes(channel=0, count=FRAMES):
    """Messages STROKES of motorcycle.dbc, every 10 ms from 0."""
    raw = {"fork_stroke_mm": STROKE_RAW, "rear_stroke_mm": REAR_RAW, "alive": np.arange(FRAMES) % 16}
    payload = Codec().pack("STROKES", raw)
    return [
        can.Message(
            timestamp=k / 100,
            arbitration_id=0x100,
            is_extended_id=False,
            data=bytes(payload[k]),
            channel=channel,
        )
        for k in range(count)
    ]


def write(path, messages):
    """Write a log of the format of the suffix; with .gz on top if that is the suffix."""
    target = path.with_suffix("") if path.suffix == ".gz" else path
    logging.disable(logging.WARNING)  # of frames that a writer passes over
    try:
        with can.Logger(target) as logger:
            for message in messages:
                logger.on_message_received(message)
    finally:
        logging.disable(logging.NOTSET)
    if path != target:
        path.write_bytes(gzip.compress(target.read_bytes()))
        target.unlink()
    return path


def candump(path, *lines):
    """Write lines of a candump log; a number is a frame of STROKES at that many milliseconds."""
    data = strokes()[1].data.hex()
    text = [
        f"({line // 1000}.{line % 1000:03}000) can0 100#{data}" if isinstance(line, int) else line
        for line in lines
    ]
    path.write_text("\n".join([*text, ""]), newline="")
    return path

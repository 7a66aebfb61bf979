"""Frames of the bench's own messages, made of physical values."""

import pytest

from bench.codec import Codec
from targets.ecu import Frame

MS = 1_000_000


@pytest.fixture(scope="session")
def codec():
    return Codec()


@pytest.fixture(scope="session")
def frame(codec):
    """Make a frame of a message; signals not given are 0."""

    def make(name, **signals):
        message = codec.message(name)
        values = dict.fromkeys(message.signals, 0.0) | signals
        return Frame(message.id, codec.encode(name, values)[0].tobytes(), message.extended)

    return make

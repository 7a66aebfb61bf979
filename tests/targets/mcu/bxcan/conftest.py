import pytest

from tests.targets.mcu.bxcan.registers import Can


@pytest.fixture
def reset():
    """CAN1 as reset leaves it."""
    return Can()


@pytest.fixture
def can():
    """CAN1 in normal mode, 500 kbit/s, a filter for every frame to FIFO 0."""
    return Can().configured().open_filter()

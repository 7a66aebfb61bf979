"""Libraries that warn of what we refuse or report ourselves, silenced while they work for us.

Belongs here: that, and nothing else.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet(name: str) -> Iterator[None]:
    """Let the logger `name`, and those below it, say nothing inside the block."""
    logger = logging.getLogger(name)
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)

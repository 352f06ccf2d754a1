"""What tests of ArduSub share."""

from collections.abc import Iterator

import fake_ardusub
import pytest


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    """No socket outlives its test."""
    yield
    while fake_ardusub.PORTS:
        fake_ardusub.PORTS.pop().close()

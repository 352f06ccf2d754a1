"""What tests of the link share."""

from collections.abc import Iterator

import fake_ardusub
import pytest


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    """No socket of a vehicle with ArduSub outlives its test."""
    yield
    while fake_ardusub.PORTS:
        fake_ardusub.PORTS.pop().close()

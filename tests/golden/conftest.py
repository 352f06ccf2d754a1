"""`python -m pytest tests/golden --update` writes the outputs anew."""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update", action="store_true", help="write tests/golden/outputs anew, where they differ")

"""A fixture that starts servers."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.serving import StartServer, servers


@pytest.fixture
def serve(tiny_store: Path, tmp_path: Path) -> Iterator[StartServer]:
    """A function that starts servers of the tiny store; they end with the test."""
    pytest.importorskip("textual_serve")
    with servers(tiny_store, tmp_path / "data") as start:
        yield start

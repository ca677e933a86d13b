"""A fixture that starts servers."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.serving import StartServer, servers


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    folder = Path(__file__).parent
    for item in items:
        if folder in item.path.parents:
            item.add_marker(pytest.mark.xdist_group("serve"))


@pytest.fixture
def serve(tiny_store: Path, tmp_path: Path) -> Iterator[StartServer]:
    """A function that starts servers of the tiny store; they end with the test."""
    pytest.importorskip("textual_serve")
    with servers(tiny_store, tmp_path / "data") as start:
        yield start

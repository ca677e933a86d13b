"""A store in which every free text column is hostile."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support import hostile


@pytest.fixture(scope="session")
def hostile_store(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with hostile texts and a history, which no test modifies; see `hostile.HOSTILE`."""
    folder = tmp_path_factory.mktemp("poisoned")
    return hostile.with_nights(
        hostile.with_hostile_texts(tiny_store, folder / "bad [ [@click=app.quit]x.s2r")
    )

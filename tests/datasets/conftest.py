"""A small paired data set on disk."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support import pairs


@pytest.fixture
def data(tmp_path: Path) -> tuple[Path, Path]:
    header = pairs.sim2realviz(tmp_path / "data", n=8)
    return tmp_path / "data", header

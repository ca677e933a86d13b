"""Stores whose errors are known: random ones, and one with a bad room and a bad run."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rstore.index.transaction import edit
from tests.support import tiny


@pytest.fixture(scope="session")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """120 instances with errors of one distribution in both rooms; two runs."""
    return tiny.build(tmp_path_factory.mktemp("plain") / "plain.s2r", n=120)


@pytest.fixture(scope="session")
def marked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Vanilla was trained on four of five instances; its real errors in room "right" are large.

    There dataaug is far better.
    """
    path = tmp_path_factory.mktemp("marked") / "marked.s2r"
    tiny.build(path, n=240, trained=("vanilla",))
    with edit(path) as draft:
        draft.rows(
            "UPDATE prediction SET error = error + 6 WHERE run = 'vanilla' AND side = 'real' "
            "AND iid IN (SELECT iid FROM instance WHERE room = 'right')"
        )
    return path

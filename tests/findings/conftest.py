"""Stores whose errors are known: random ones, and one with a bad room and a bad run."""

from pathlib import Path

import pytest

from s2rstore.index.transaction import edit
from tests.conftest import BuildOnce
from tests.support import tiny


@pytest.fixture(scope="session")
def plain(build_once: BuildOnce) -> Path:
    """300 instances with errors of one distribution in both rooms; two runs."""
    return build_once("plain.s2r", lambda path: tiny.build(path, n=300))


@pytest.fixture(scope="session")
def marked(build_once: BuildOnce) -> Path:
    """Vanilla was trained on four of five instances; its real errors in room "right" are large.

    There dataaug is far better.
    """
    return build_once("marked.s2r", _build_marked)


def _build_marked(path: Path) -> None:
    tiny.build(path, n=560, trained=("vanilla",))
    with edit(path) as draft:
        draft.rows(
            "UPDATE prediction SET error = error + 6 WHERE run = 'vanilla' AND side = 'real' "
            "AND iid IN (SELECT iid FROM instance WHERE room = 'right')"
        )

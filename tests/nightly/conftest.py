"""A nightly gate with a week of nights and a regression on day 5."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from s2rtools.nightly import publish
from s2rtools.nightly.config import NightlyConfig, SysidTable
from tests.support import nights


@pytest.fixture
def config(tmp_path: Path, tiny_store: Path) -> NightlyConfig:
    """A gate on a separate store with drives, metrics and a simulator to identify."""
    return make_config(tmp_path, tiny_store)


@pytest.fixture
def constant_plot(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nights of this test draw no plot, which takes most of their time."""
    monkeypatch.setattr(publish, "history_plot", lambda *arguments: b"a plot")


@pytest.fixture
def week(config: NightlyConfig) -> nights.Week:
    return nights.Week(config, {"task": 20.0}, from_day=5)


@pytest.fixture(scope="session")
def recorded_week(tmp_path_factory: pytest.TempPathFactory, tiny_store: Path) -> nights.Week:
    """All seven nights, for tests that only read; the task gap grows on day 5."""
    config = make_config(tmp_path_factory.mktemp("week"), tiny_store)
    week = nights.Week(config, {"task": 20.0}, from_day=5)
    for number in range(1, 8):
        week.night(number)
    return week


def make_config(folder: Path, store: Path) -> NightlyConfig:
    shutil.copytree(store, folder / "lab.s2r")
    config = nights.write_config(folder, folder / "lab.s2r")
    return replace(config, sysid=SysidTable(str(folder / "drives")))


def files(config: NightlyConfig) -> dict[Path, tuple[bytes, int]]:
    """Content and modification time of all files that a night may write, except locks."""
    roots = [config.history.parent, config.reports]
    paths = [path for root in roots for path in root.rglob("*")]
    files_without_locks = [path for path in paths if path.is_file() and path.suffix != ".lock"]
    assert config.metrics is not None
    return {
        path: (path.read_bytes(), path.stat().st_mtime_ns)
        for path in (*files_without_locks, config.metrics)
    }

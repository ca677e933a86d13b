"""A week of nights with a regression on day 5."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from s2rtools.nightly.config import NightlyConfig, SysidConfig
from tests.support import nights


@pytest.fixture
def config(tmp_path: Path, tiny_store: Path) -> NightlyConfig:
    """A gate on a store of its own, with drives, metrics and a simulator to identify."""
    return made(tmp_path, tiny_store)


@pytest.fixture
def week(config: NightlyConfig) -> nights.Week:
    return nights.Week(config, {"task": 20.0}, from_day=5)


@pytest.fixture(scope="session")
def told_week(tmp_path_factory: pytest.TempPathFactory, tiny_store: Path) -> nights.Week:
    """All seven nights, for tests that only read; the task's gap grows on day 5."""
    config = made(tmp_path_factory.mktemp("week"), tiny_store)
    week = nights.Week(config, {"task": 20.0}, from_day=5)
    for number in range(1, 8):
        week.night(number)
    return week


def made(folder: Path, store: Path) -> NightlyConfig:
    shutil.copytree(store, folder / "lab.s2r")
    config = nights.write_config(folder, folder / "lab.s2r")
    return replace(config, sysid=SysidConfig(str(folder / "drives")))


def files(config: NightlyConfig) -> dict[Path, tuple[bytes, int]]:
    """Content and time of every file that a night may write; locks name their last holder."""
    roots = [config.history.parent, config.reports]
    found = [path for root in roots for path in root.rglob("*")]
    kept = [path for path in found if path.is_file() and path.suffix != ".lock"]
    assert config.metrics is not None
    return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in (*kept, config.metrics)}

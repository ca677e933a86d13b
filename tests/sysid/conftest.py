"""Small drives of known truth, and what was identified from them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from s2rtools.motion_logs import Drive
from s2rtools.sysid import Identification, Recording, SysidSettings, identify, make_drives

QUICK = SysidSettings(seeds=1, evaluations=160)


class Silent:
    """A reporter that adds up what it is told."""

    def __init__(self) -> None:
        self.total, self.done = 0, 0

    def begin(self, what: str, total: int) -> None:
        self.total += total

    def advance(self, steps: int) -> None:
        self.done += steps

    def say(self, line: str) -> None: ...


Made = tuple[Path, tuple[Drive, ...]]


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Made]:
    """Folders of drives by severity and recording, each made once."""
    kept: dict[str, Made] = {}

    def make(efforts: bool = False, **severities: float) -> Made:
        key = f"{efforts}{sorted(severities.items())}"
        if key not in kept:
            folder = tmp_path_factory.mktemp("drives") / "all"
            recording = Recording(count=8, seconds=9.5, efforts=efforts)
            kept[key] = folder, make_drives(folder, 11, severities, recording)
        return kept[key]

    return make


@pytest.fixture(scope="session")
def plain(made: Callable[..., Made]) -> Identification:
    """Latency and mass differ; the simulator can follow."""
    return identify(made(latency=0.8, mass=1.0)[1], QUICK, Silent())


@pytest.fixture(scope="session")
def unequal(made: Callable[..., Made]) -> Identification:
    """The real wheels are of unequal radius, which no searched parameter can follow."""
    return identify(made(latency=0.8, wheels=1.0)[1], QUICK, Silent())

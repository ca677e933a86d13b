"""Small drives with known parameters, and identifications from them."""

from collections.abc import Callable
from pathlib import Path

import pytest

from s2rtools.motion_logs import Drive
from s2rtools.sysid.identify import Identification, SysidSettings, identify
from s2rtools.sysid.synthetic_drives import DriveSettings, make_drives
from tests.support.silent_reporter import SilentReporter

QUICK = SysidSettings(seeds=1, evaluations=160)


DriveFolder = tuple[Path, tuple[Drive, ...]]


@pytest.fixture(scope="session")
def drive_folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., DriveFolder]:
    """Folders of drives by severity and recording, each created once."""
    cache: dict[str, DriveFolder] = {}

    def make_folder(efforts: bool = False, **severities: float) -> DriveFolder:
        key = f"{efforts}{sorted(severities.items())}"
        if key not in cache:
            folder = tmp_path_factory.mktemp("drives") / "all"
            recording = DriveSettings(count=8, seconds=9.5, efforts=efforts)
            cache[key] = folder, make_drives(folder, 11, severities, recording)
        return cache[key]

    return make_folder


@pytest.fixture(scope="session")
def identified(drive_folder: Callable[..., DriveFolder]) -> Identification:
    """Latency and mass differ; the simulator can represent both."""
    return identify(drive_folder(latency=0.8, mass=1.0)[1], QUICK, SilentReporter())


@pytest.fixture(scope="session")
def identified_unequal_wheels(drive_folder: Callable[..., DriveFolder]) -> Identification:
    """The real wheels have different radii, which no searched parameter can represent."""
    return identify(drive_folder(latency=0.8, wheels=1.0)[1], QUICK, SilentReporter())

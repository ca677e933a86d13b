"""A ROS 1 master on loopback, and a translator file."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from bench.support.ros_programs import RosNetwork, missing_ros
from s2rtools.translation.colour_maps import MklTranslator
from s2rtools.translation.translator_file import StoredTranslator, encode

WAIT = 120.0
"""Seconds after which a condition counts as not reached; far more than any test needs."""


def wait_until(condition: Callable[[], object], what: str) -> None:
    """Wait until a condition holds; fails after `WAIT` seconds."""
    end = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < end, f"{what}: not reached"
        time.sleep(0.05)


def shifted(offset: float) -> StoredTranslator:
    """A translator that adds `offset` to red and removes it from blue."""
    source = np.vstack([np.full(3, 120.0), np.eye(3) * 900])
    target = source + np.pad([[offset, 0.0, -offset]], ((0, 3), (0, 0)))
    return StoredTranslator(MklTranslator(target, source), "real", "sim", (48, 64))


@pytest.fixture
def translator_file(tmp_path: Path) -> Path:
    path = tmp_path / "redder.safetensors"
    path.write_bytes(encode(shifted(40)))
    return path


@pytest.fixture
def network(tmp_path: Path) -> Iterator[RosNetwork]:
    """A network without any program yet; all are ended after the test."""
    missing = missing_ros()
    if missing:
        pytest.skip(f"ROS 1 is not installed: {missing} is missing (see .ci/programs)")
    started = RosNetwork(tmp_path / "ros")
    yield started
    started.stop()

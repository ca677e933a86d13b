"""Text files with random damage are read with reports, or refused in one line."""

from __future__ import annotations

import random
import warnings
from pathlib import Path

import numpy as np
import pytest

from s2rstore.errors import RequestError
from tests.datasets.layouts.checks import read_with
from tests.datasets.layouts.recordings import drive
from tests.datasets.layouts.test_layouts_find_the_truth import NAMES, write

INSERTED = [
    b"nan", b"-inf", b"1e400", b"", b"\n", b" ", b",", b"-1", b"9" * 400, b"\xff", b"\0", b"[",
    b'"', b"../x", b"{", b":", b"#", b"1e308", b"1e-320",
]  # fmt: skip
ROUNDS = 60


def damaged(content: bytes, rng: random.Random) -> bytes:
    place = rng.randrange(len(content) + 1)
    kind = rng.randrange(5)
    if kind == 0:
        return content[:place] + rng.choice(INSERTED) + content[place + rng.choice([0, 1, 8]) :]
    if kind == 1:
        return content[:place] + content[place + rng.randrange(1, 40) :]
    if kind == 2:
        return content[:place]
    if kind == 3:
        return content[:place] + bytes([rng.randrange(256)]) + content[place + 1 :]
    lines = content.split(b"\n")
    rng.shuffle(lines)
    return b"\n".join(lines)


@pytest.mark.parametrize("layout", NAMES)
def test_damage_is_reported_or_refused(layout: str, tmp_path: Path) -> None:
    path, _ = write(layout, tmp_path / "recording", drive(0.1 * k for k in range(4)))
    suffixes = (".txt", ".csv", ".yaml", ".toml")
    texts = sorted(p for p in (tmp_path / "recording").rglob("*") if p.suffix in suffixes)
    outcomes = set()
    for number in range(ROUNDS):
        rng = random.Random(number)
        file = rng.choice(texts)
        content = file.read_bytes()
        file.write_bytes(damaged(content, rng))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            outcomes.add(outcome(layout, path))
        file.write_bytes(content)
    assert outcomes == ({"read"} if layout == "7scenes" else {"read", "refused"})


def outcome(layout: str, path: Path) -> str:
    try:
        found = read_with(layout, path)
    except RequestError as error:
        return "refused in several lines" if "\n" in str(error) else "refused"
    for trajectory in found.trajectories.values():
        count = len(trajectory.frames)
        assert count > 0
        assert trajectory.poses.shape == (count, 4, 4)
        assert trajectory.timestamps.shape == (count,)
        assert np.isfinite(trajectory.poses).all()
    for issue in found.issues:
        assert issue.kind
        assert issue.file
        assert "\n" not in issue.kind + issue.file + issue.detail
    return "read"

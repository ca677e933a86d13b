"""Faults that are planted into clean recordings are found, and nothing else."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from s2rtools.data_health.faults import RULES, Recorded, faults
from s2rtools.data_health.measures import ImageMeasures

N, SIZE = 60, 96
LEAST, MOST = 1, 4000
PLANTED = (7, 8, 21, 40, 52)


def scene(rng: np.random.Generator) -> np.ndarray:
    """A wide wall with boxes, of which a walk shows one part after the other."""
    wall = np.full((SIZE, 14 * N + SIZE, 3), 150, np.uint8)
    for _ in range(1600):
        x, y = rng.integers(0, wall.shape[1]), rng.integers(0, SIZE)
        colour = tuple(int(value) for value in rng.integers(30, 226, 3))
        cv2.rectangle(wall, (x, y), (x + int(rng.integers(4, 40)), y + int(rng.integers(4, 30))),
                      colour, -1)  # fmt: skip
    return wall


class Walk:
    """A clean recording: images, depth, poses and times, which a test changes."""

    def __init__(self) -> None:
        rng = np.random.default_rng(2)
        wall = scene(rng)
        self.rgb = np.stack([wall[:, 14 * at : 14 * at + SIZE] for at in range(N)])
        self.depth = rng.integers(500, 3000, (N, SIZE, SIZE)).astype(np.uint16)
        self.poses = np.stack([0.2 * np.arange(N), np.zeros(N), np.zeros(N)], axis=1)
        self.times = 0.1 * np.arange(N)

    def found(self) -> dict[str, list[int]]:
        measures, previous = ImageMeasures.empty(N), None
        for iid, (rgb, raw) in enumerate(zip(self.rgb, self.depth, strict=True)):
            previous = measures.measure(iid, rgb, previous)
            measures.measure_depth(iid, raw, LEAST, MOST)
        recorded = Recorded(measures, self.poses, self.times, np.zeros(N, np.int64))
        return {fault.name: fault.iids.tolist() for fault in faults(recorded, "real")}


def blur(walk: Walk) -> None:
    for iid in PLANTED:
        walk.rgb[iid] = cv2.GaussianBlur(walk.rgb[iid], (0, 0), 1.5)


def move_while_exposed(walk: Walk) -> None:
    for iid in PLANTED:
        walk.rgb[iid] = cv2.blur(cv2.blur(walk.rgb[iid], (7, 1)), (1, 5))


def darken(walk: Walk) -> None:
    walk.rgb[list(PLANTED)] //= 40


def brighten(walk: Walk) -> None:
    for iid in PLANTED:
        walk.rgb[iid] = np.clip(walk.rgb[iid].astype(np.int16) + 200, 0, 255)


def freeze(walk: Walk) -> None:
    for iid in PLANTED:
        walk.rgb[iid] = walk.rgb[iid - 1]


def repeat(walk: Walk) -> None:
    for iid in (40, 52):
        walk.rgb[iid] = walk.rgb[iid - 20]


def misplace(walk: Walk) -> None:
    for iid in (40, 52):
        walk.rgb[iid] = np.clip(walk.rgb[iid - 20].astype(np.int16) + 3, 0, 255)


def lose_depth(walk: Walk) -> None:
    walk.depth[list(PLANTED), :70] = 0


def saturate_depth(walk: Walk) -> None:
    walk.depth[list(PLANTED), :40] = MOST


def jump_in_time(walk: Walk) -> None:
    for iid in (20, 40):
        walk.times[iid:] += 2.0
    walk.times[30] = walk.times[29]


def jump_in_space(walk: Walk) -> None:
    for iid in (20, 40):
        walk.poses[iid:, 0] += 3.0


@pytest.mark.parametrize(
    ("plant", "name", "expected"),
    [
        (blur, "blurred", [*PLANTED]),
        (move_while_exposed, "blurred", [*PLANTED]),
        (darken, "too dark", [*PLANTED]),
        (brighten, "too bright", [*PLANTED]),
        (freeze, "frozen", [*PLANTED]),
        (repeat, "repeated", [20, 32, 40, 52]),
        (misplace, "misplaced", [20, 32, 40, 52]),
        (lose_depth, "depth holes", [*PLANTED]),
        (saturate_depth, "depth saturated", [*PLANTED]),
        (jump_in_time, "time jump", [20, 30, 40]),
        (jump_in_space, "pose jump", [20, 40]),
    ],
    ids=lambda value: value.__name__ if callable(value) else "",
)
def test_planted_faults_are_found(plant: Callable[[Walk], None], name: str, expected: list[int]):
    walk = Walk()
    assert walk.found() == {}
    plant(walk)
    assert walk.found()[name] == expected


def test_every_rule_is_planted():
    planted = {"blurred", "too dark", "too bright", "frozen", "repeated", "misplaced",
               "depth holes", "depth saturated", "time jump", "pose jump"}  # fmt: skip
    assert planted == set(RULES)


def test_trajectories_have_no_steps_between_them():
    walk = Walk()
    measures = ImageMeasures.empty(N)
    walk.poses[30:, 0] += 100.0
    walk.times[30:] = walk.times[:30]
    codes = (np.arange(N) >= 30).astype(np.int64)
    recorded = Recorded(measures, walk.poses, walk.times, codes)
    assert list(faults(recorded, "real")) == []


def test_the_command_prints_expressions_that_select_the_instances(tiny_store, s2r):
    for fault in s2r("check", tiny_store, "--json").json:
        selected = s2r("query", tiny_store, fault["expression"], "--with-trained", "--count")
        assert int(selected.printed) == fault["n"]
    s2r("check", tiny_store, "--domain", "nowhere").assert_refused("nowhere")

"""Precision and recall of `s2r check` on faults planted into a tour of the synthetic world.

python -m bench faults
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

import s2rstore
from bench.budget import BudgetRow
from s2rstore.image_faults import FAULTS
from s2rstore.records import SIDES
from s2rtools.data_health.faults import RULES, Recorded
from s2rtools.data_health.measures import ImageMeasures
from s2rtui.cli import main

LEAST, MOST = 1, 4000
SHARE = 0.95
"""Least precision and recall."""
COUNT, RNG = 300, np.random.default_rng(3)
SPOILED = np.sort(RNG.permutation(np.arange(10, COUNT - 10, 5))[:24])
"""Images of a tour that are made faulty; no two of them follow each other."""


class Tour:
    """The first tour of the synthetic world."""

    def __init__(self, path: Path) -> None:
        with s2rstore.open(path) as store:
            sim, real = (store.frames(side, 0, COUNT) for side in SIDES)
            self.poses = store.poses("real")[:COUNT].copy()
        self.times = 0.1 * np.arange(COUNT)
        self.rgb, self.depth = sim["rgb"], sim["depth"]
        self.sim = self.measures()
        self.rgb, self.depth = real["rgb"], real["depth"]
        self.is_trained = np.zeros(COUNT, bool)

    def measures(self) -> ImageMeasures:
        """Measures of the present images."""
        measures, previous = ImageMeasures.empty(COUNT), None
        for iid, (rgb, raw) in enumerate(zip(self.rgb, self.depth, strict=True)):
            previous = measures.measure(iid, rgb, previous)
            measures.measure_depth(iid, raw, LEAST, MOST)
        return measures

    def found(self, name: str) -> set[int]:
        """The images with a fault."""
        recorded = Recorded(
            self.measures(), self.poses, self.times, np.zeros(COUNT, np.int64),
            [(self.is_trained, ~self.is_trained)], self.sim,
        )  # fmt: skip
        return {*np.flatnonzero(RULES[name](recorded)).tolist()}

    def sources(self, farther: float) -> np.ndarray:
        """For each spoiled image another one, more than some metres away."""
        others = np.setdiff1d(np.arange(COUNT), [SPOILED - 1, SPOILED, SPOILED + 1])
        away = np.hypot(*(self.poses[SPOILED, None, :2] - self.poses[None, others, :2]).T) > farther
        return np.array([RNG.choice(others[each]) for each in away.T])


def spoil_images(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Tour], set[int]]:
    def spoil(tour: Tour) -> set[int]:
        for iid in SPOILED:
            tour.rgb[iid] = np.clip(change(tour.rgb[iid].astype(np.int16)), 0, 255)
        return {*SPOILED}

    return spoil


def spoil_depth(value: int) -> Callable[[Tour], set[int]]:
    def spoil(tour: Tour) -> set[int]:
        tour.depth[SPOILED, 30:] = value
        return {*SPOILED}

    return spoil


def copied(farther: float, brighter: int, with_pose: bool = False) -> Callable[[Tour], set[int]]:
    def spoil(tour: Tour) -> set[int]:
        sources = tour.sources(farther)
        tour.rgb[SPOILED] = np.clip(tour.rgb[sources].astype(np.int16) + brighter, 0, 255)
        if with_pose:
            tour.poses[SPOILED] = tour.poses[sources]
            tour.is_trained[sources] = True
        return {*SPOILED} if with_pose else {*SPOILED, *sources}

    return spoil


def spoil_pairs(tour: Tour) -> set[int]:
    tour.rgb[SPOILED] = tour.rgb[tour.sources(4.0)]
    return {*SPOILED}


def freeze_tour(tour: Tour) -> set[int]:
    tour.rgb[SPOILED] = tour.rgb[SPOILED - 1]
    return {*SPOILED}


def stand_still(tour: Tour) -> set[int]:
    tour.rgb[SPOILED] = np.clip(tour.rgb[SPOILED - 1].astype(np.int16) + 1, 0, 255)
    tour.poses[SPOILED] = tour.poses[SPOILED - 1]
    return {*SPOILED}


def jump_in_tour(tour: Tour) -> set[int]:
    for iid in SPOILED:
        tour.times[iid:] += 2.0
    return {*SPOILED}


def carry_in_tour(tour: Tour) -> set[int]:
    """Only some, because a jump is a step that few others are as long as."""
    for iid in SPOILED[::3]:
        tour.poses[iid:, 0] += 4.0
    return {*SPOILED[::3]}


SPOILS: dict[str, Callable[[Tour], set[int]]] = {
    "blurred": spoil_images(lambda image: cv2.GaussianBlur(image, (0, 0), 1.5)),
    "dark": spoil_images(lambda image: image // 30),
    "bright": spoil_images(lambda image: image + 170),
    "frozen": freeze_tour, "repeated": copied(1.0, 0), "misplaced": copied(2.5, 3),
    "mispaired": spoil_pairs, "duplicate": stand_still, "leaked": copied(1.0, 2, with_pose=True),
    "depth_holes": spoil_depth(0), "depth_saturated": spoil_depth(MOST),
    "time_jump": jump_in_tour, "pose_jump": carry_in_tour,
}  # fmt: skip


def figures(folder: Path) -> Iterator[BudgetRow]:
    """Precision and recall of each fault."""
    path = folder / "tour.s2r"
    main(["ingest", "world", "--instances", str(COUNT), "--store", str(path)])
    for name in FAULTS:
        tour = Tour(path)
        planted = SPOILS[name](tour)
        found = tour.found(name)
        right = len(found & planted)
        details = {"planted": len(planted), "found": len(found)}
        for figure, of in (("precision", found), ("recall", planted)):
            value = right / max(1, len(of))
            yield BudgetRow(f"{name}: {figure}", value, "", SHARE, "at least", details)

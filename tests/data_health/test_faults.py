"""Faults that are planted into clean recordings are found, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import s2rstore
from s2rstore.image_faults import FAULTS
from s2rstore.index import schema
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.records import SIDES
from s2rtools.data_health.faults import RULES, Recorded, faults
from s2rtools.data_health.measures import ImageMeasures
from tests.support.application import press, running
from tests.support.copies import copy_store

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

    def measures(self) -> ImageMeasures:
        measures, previous = ImageMeasures.empty(len(self.rgb)), None
        for iid, (rgb, raw) in enumerate(zip(self.rgb, self.depth, strict=True)):
            previous = measures.measure(iid, rgb, previous)
            measures.measure_depth(iid, raw, LEAST, MOST)
        return measures

    def found(self, **more: Any) -> dict[str, list[int]]:
        trajectories = np.zeros(len(self.rgb), np.int64)
        recorded = Recorded(self.measures(), self.poses, self.times, trajectories, **more)
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
        (darken, "dark", [*PLANTED]),
        (brighten, "bright", [*PLANTED]),
        (freeze, "frozen", [*PLANTED]),
        (repeat, "repeated", [20, 32, 40, 52]),
        (misplace, "misplaced", [20, 32, 40, 52]),
        (lose_depth, "depth_holes", [*PLANTED]),
        (saturate_depth, "depth_saturated", [*PLANTED]),
        (jump_in_time, "time_jump", [20, 30, 40]),
        (jump_in_space, "pose_jump", [20, 40]),
    ],
    ids=lambda value: value.__name__ if callable(value) else "",
)
def test_planted_faults_are_found(plant: Callable[[Walk], None], name: str, expected: list[int]):
    walk = Walk()
    assert walk.found() == {}
    plant(walk)
    assert walk.found()[name] == expected


def test_an_image_is_a_duplicate_and_leaks_between_training_and_evaluation():
    walk = Walk()
    walk.rgb[40] = np.clip(walk.rgb[20].astype(np.int16) + 3, 0, 255)
    walk.poses[40:] += walk.poses[20] - walk.poses[40]
    is_trained = np.arange(N) < 30
    found = walk.found(splits=[(is_trained, ~is_trained)])
    assert (found["duplicate"], found["leaked"]) == ([40], [40])
    assert "leaked" not in walk.found(splits=[(is_trained, np.zeros(N, bool))])


def test_the_sim_image_of_another_place_is_mispaired():
    walk, sim = Walk(), Walk()
    sim.rgb = sim.rgb // 2 + 20
    sim.rgb[[10, 40]] = sim.rgb[[40, 10]]
    assert walk.found(sim=sim.measures()) == {"mispaired": [10, 40]}


def test_a_fault_has_a_rule_and_a_meaning():
    assert list(RULES) == list(FAULTS)


def test_trajectories_have_no_steps_between_them():
    walk = Walk()
    measures = ImageMeasures.empty(N)
    walk.poses[30:, 0] += 100.0
    walk.times[30:] = walk.times[:30]
    codes = (np.arange(N) >= 30).astype(np.int64)
    recorded = Recorded(measures, walk.poses, walk.times, codes)
    assert list(faults(recorded, "real")) == []


def test_the_command_records_the_faults_that_the_language_selects(tiny_store, tmp_path, s2r):
    path = copy_store(tiny_store, tmp_path / "own.s2r")
    with edit(path) as draft:
        draft.delete("frame_fault")
        draft.delete("provenance", what=schema.HEALTH)
    s2r("query", path, "health:repeated").assert_refused("s2r check")
    assert s2r("check", path, "--dry-run", "--json").json
    s2r("query", path, "health:repeated").assert_refused("s2r check")
    faults = s2r("check", path, "--json").json
    assert s2r("query", path, "health:sharp").checked(2).err.count("blurred") == 1
    rows = {
        (row["fault"], row["domain"]): row for row in s2r("show", path, "health", "--json").json
    }
    for fault in faults:
        selected = s2r("query", path, fault["expression"], "--with-trained", "--count")
        row = rows.pop((fault["fault"], fault["domain"]))
        assert int(selected.printed) == fault["n"] == row["n"]
        with s2rstore.open(path) as store:
            in_sql, parameters = evaluation.sql(store, row["expression"], with_trained=True)
            mask = evaluation.select(store, row["expression"], with_trained=True)
            assert np.flatnonzero(mask).tolist() == [
                i for (i,) in store.execute(in_sql, parameters)
            ]
    assert not rows
    of_real = [fault for fault in faults if fault["domain"] == "real"]
    assert s2r("check", path, "--domain", "real", "--json").json == of_real  # still with pairs
    with edit(path) as draft:
        draft.set_provenance(schema.HEALTH, {"real": "30"})
    out = tmp_path / "screen.txt"
    s2r("snapshot", path, "--size", "120x40", "--keys", "(", "--out", out).checked(0)
    assert "10 images were added after the check" in out.read_text()
    s2r("check", path, "--domain", "nowhere").assert_refused("nowhere")


def test_a_recording_is_checked_before_it_is_ingested(tmp_path, s2r):
    walk = Walk()
    freeze(walk)
    lines = ["rgb,x,y,heading,timestamp"]
    for iid, rgb in enumerate(walk.rgb):
        cv2.imwrite(str(tmp_path / f"{iid}.png"), rgb[..., ::-1])
        lines.append(f"{iid}.png,{walk.poses[iid, 0]},0,0,{walk.times[iid]}")
    (tmp_path / "walk.csv").write_text("\n".join(lines))
    (tmp_path / "walk.toml").write_text(f"[camera]\nwidth = {SIZE}\nheight = {SIZE}\nhfov = 70.0\n")
    rows = s2r("check", f"csv:{tmp_path / 'walk.csv'}", "--json").json
    found = {row["fault"]: row["images"] for row in rows}
    assert found["frozen"] == [f"{iid}.png" for iid in PLANTED]
    assert set(found) == {"frozen", "repeated"}  # image 8 is that of 6, too
    assert "frozen" in s2r("check", f"csv:{tmp_path / 'walk.csv'}", "--strict").checked(1).out
    s2r("check", "cvs:walk.csv").assert_refused("no layout 'cvs'")


COUNT, RNG = 300, np.random.default_rng(3)
SPOILED = np.sort(RNG.permutation(np.arange(10, COUNT - 10, 5))[:24])
"""Images of a tour that are made faulty; no two of them follow each other."""


class Tour(Walk):
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


@pytest.mark.deep
def test_precision_and_recall_of_planted_faults_are_at_least_95_percent(tmp_path, s2r):
    path = tmp_path / "world.s2r"
    s2r("ingest", "world", "--instances", COUNT, "--store", path)
    for name in FAULTS:
        tour = Tour(path)
        expected = SPOILS[name](tour)
        found = {*tour.found(sim=tour.sim, splits=[(tour.is_trained, ~tour.is_trained)])[name]}
        right = len(found & expected)
        assert right >= 0.95 * max(len(found), len(expected)), name


@pytest.mark.parametrize(
    ("key", "expressions"),
    [
        ("left_parenthesis", ("health:blurred", "health:frozen")),
        ("colon", ('label:"fire door"', "label:chair")),
    ],
)
async def test_enter_selects_the_instances_of_a_row(tiny_store, key, expressions):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, key, "enter")
        assert app.session.state.expression == expressions[0]
        await press(app, pilot, "down", "enter")
        assert app.session.state.expression == expressions[1]
        assert app.session.state.selected.any()

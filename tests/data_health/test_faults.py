"""Faults that are planted into clean recordings are found, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from s2rstore.image_faults import FAULTS
from s2rstore.index import schema
from s2rstore.index.transaction import edit
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


Plant = Callable[[Walk], None]


def images(change: Callable[[np.ndarray], np.ndarray]) -> Plant:
    def plant(walk: Walk) -> None:
        for iid in PLANTED:
            walk.rgb[iid] = np.clip(change(walk.rgb[iid].astype(np.int16)), 0, 255)

    return plant


def copies(back: int, brighter: int, *iids: int) -> Plant:
    def plant(walk: Walk) -> None:
        for iid in iids:
            walk.rgb[iid] = np.clip(walk.rgb[iid - back].astype(np.int16) + brighter, 0, 255)

    return plant


def depth(rows: int, value: int) -> Plant:
    def plant(walk: Walk) -> None:
        walk.depth[list(PLANTED), :rows] = value

    return plant


def jump_in_time(walk: Walk) -> None:
    for iid in (20, 40):
        walk.times[iid:] += 2.0
    walk.times[30] = walk.times[29]


def jump_in_space(walk: Walk) -> None:
    for iid in (20, 40):
        walk.poses[iid:, 0] += 3.0


@pytest.mark.parametrize(
    ("name", "plant", "expected"),
    [
        ("blurred", images(lambda image: cv2.GaussianBlur(image, (0, 0), 1.5)), [*PLANTED]),
        ("blurred", images(lambda i: cv2.blur(cv2.blur(i, (7, 1)), (1, 5))), [*PLANTED]),
        ("dark", images(lambda image: image // 40), [*PLANTED]),
        ("bright", images(lambda image: image + 200), [*PLANTED]),
        ("frozen", copies(1, 0, *PLANTED), [*PLANTED]),
        ("repeated", copies(20, 0, 40, 52), [20, 32, 40, 52]),
        ("misplaced", copies(20, 3, 40, 52), [20, 32, 40, 52]),
        ("depth_holes", depth(70, 0), [*PLANTED]),
        ("depth_saturated", depth(40, MOST), [*PLANTED]),
        ("time_jump", jump_in_time, [20, 30, 40]),
        ("pose_jump", jump_in_space, [20, 40]),
    ],
)
def test_planted_faults_are_found(name: str, plant: Plant, expected: list[int]):
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
    rows = s2r("show", path, "health", "--json").json
    counts = {(row["fault"], row["domain"]): row["n"] for row in rows}
    assert counts == {(fault["fault"], fault["domain"]): fault["n"] for fault in faults}
    for fault in faults:
        selected = s2r("query", path, fault["expression"], "--with-trained", "--count")
        assert int(selected.printed) == fault["n"]
    of_real = [fault for fault in faults if fault["domain"] == "real"]
    assert s2r("check", path, "--domain", "real", "--json").json == of_real  # still with pairs
    with edit(path) as draft:
        draft.set_provenance(schema.HEALTH, {"real": "30"})
        draft.delete("run")  # images are checked before there is a model
    out = tmp_path / "screen.txt"
    s2r("snapshot", path, "--size", "120x40", "--keys", "(", "--out", out).checked(0)
    assert "10 images were added after the check" in out.read_text()
    s2r("check", path, "--domain", "nowhere").assert_refused("nowhere")


def test_a_recording_is_checked_before_it_is_ingested(tmp_path, s2r):
    walk = Walk()
    copies(1, 0, *PLANTED)(walk)
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

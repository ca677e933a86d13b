"""Rows are matched with instances by iid, image, position or time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtools.prediction_import.instance_matching import (
    NONE,
    ImageIndex,
    first_of_each,
    match_iids,
    match_image,
    match_positions,
    match_times,
)

PARTS = st.text(alphabet="ab1_", min_size=1, max_size=3)
NUMBERS = st.one_of(st.integers(-5, 30).map(float), st.floats())
PATHS = st.lists(PARTS, min_size=1, max_size=4).map("/".join)


@given(st.lists(NUMBERS, max_size=30), st.integers(0, 20))
def test_every_row_has_an_iid_of_the_store_or_a_reason(values, count):
    found = match_iids(np.array(values, dtype=np.float64), count)
    for row, (value, iid) in enumerate(zip(values, found.iids.tolist(), strict=True)):
        assert (iid == NONE) == (row in found.reasons)
        assert iid in (NONE, value)
        assert (iid != NONE) == (value in range(count))


def test_reasons_name_the_iid():
    reasons = match_iids(np.array([3.0, 7.0, 1.5, np.nan]), 5).reasons
    assert reasons == {1: "iid 7: the store holds 0 .. 4", 2: "iid is no whole number",
                       3: "iid is no whole number"}  # fmt: skip


@given(st.lists(PATHS, min_size=1, max_size=12, unique=True), st.data())
def test_each_image_is_found_by_its_own_path(paths, data):
    index = ImageIndex(list(enumerate(paths)))
    iid = data.draw(st.integers(0, len(paths) - 1))
    assert match_image(paths[iid], index) == (iid, "")
    assert match_image(f"./{paths[iid]}", index) == (iid, "")


@given(st.lists(PATHS, min_size=1, max_size=12, unique=True), PATHS)
def test_an_image_is_found_by_the_end_of_its_path_unless_several_have_it(paths, given_path):
    def is_end(path: str) -> bool:
        return f"/{path}".endswith(f"/{given_path}") or f"/{given_path}".endswith(f"/{path}")

    expected = [iid for iid, path in enumerate(paths) if is_end(path)]
    exact = [iid for iid, path in enumerate(paths) if path == given_path]
    iid, reason = match_image(given_path, ImageIndex(list(enumerate(paths))))
    candidates = exact or expected
    assert iid == (candidates[0] if len(candidates) == 1 else NONE)
    assert bool(reason) == (iid == NONE)


def test_an_image_of_another_folder_is_not_taken():
    index = ImageIndex([(0, "left/0001.png"), (1, "right/0002.png")])
    assert match_image("0001.png", index) == (0, "")
    assert match_image("/data/set/right/0002.png", index) == (1, "")
    assert match_image("data\\right\\0002.png", index) == (1, "")
    assert match_image("right/0001.png", index)[0] == NONE
    assert match_image("", index)[0] == NONE


def test_positions_are_matched_by_trajectory_and_seq():
    known = {("a", 0): 0, ("a", 1): 1, ("b", 0): 2}
    found = match_positions(["b", "a", "c", "a"], np.array([0.0, 1.0, 0.0, 0.5]), known)
    assert found.iids.tolist() == [2, 1, NONE, NONE]
    assert found.reasons[2] == "no instance with trajectory 'c' and seq 0"


def slow_match(
    times: list[float], stamps: list[float], tolerance: float
) -> tuple[list[int], list[float]]:
    """The nearest stamp of each time, each stamp left to the nearest of its times, by loops."""
    best: dict[int, tuple[float, int]] = {}
    for row, time in enumerate(times):
        distances = [abs(time - stamp) for stamp in stamps]
        if not distances or min(distances) > tolerance:
            continue
        iid = distances.index(min(distances))
        best[iid] = min(best.get(iid, (np.inf, -1)), (distances[iid], row))
    iids, offsets = [NONE] * len(times), [np.nan] * len(times)
    for iid, (distance, row) in best.items():
        iids[row], offsets[row] = iid, distance
    return iids, offsets


@given(
    st.lists(st.integers(0, 200), max_size=25),
    st.lists(st.integers(0, 50), max_size=12, unique=True).map(sorted),
    st.integers(0, 6),
)
def test_times_are_matched_as_by_loops(times, stamps, tolerance):
    rows, instances = [t / 4 for t in times], [float(t) for t in stamps]
    found = match_times(
        np.array(rows), np.array(instances), np.zeros(len(stamps), np.int32), tolerance / 4
    )
    iids, offsets = slow_match(rows, instances, tolerance / 4)
    assert found.iids.tolist() == iids
    np.testing.assert_array_equal(found.offsets, offsets)
    assert set(found.reasons) == {row for row, iid in enumerate(iids) if iid == NONE}


def test_times_that_fit_several_trajectories_need_their_names():
    stamps, trajectories = np.array([0.0, 1.0, 0.0, 1.01]), np.array([0, 0, 1, 1], np.int32)
    times = np.array([0.0, 1.0, 5.0])
    found = match_times(times, stamps, trajectories, 0.02)
    assert found.iids.tolist() == [NONE] * 3
    assert found.reasons[0].startswith("its time fits several trajectories")
    assert found.reasons[2] == "the nearest instance is 3.99 s away"
    named = match_times(times, stamps, trajectories, 0.02, np.array([1, 1, 0], np.int32))
    assert named.iids.tolist() == [2, 3, NONE]


@pytest.mark.parametrize("time", [np.nan, np.inf])
def test_a_time_that_is_no_number_has_no_match(time):
    found = match_times(np.array([time]), np.array([0.0]), np.zeros(1, np.int32), 1.0)
    assert found.iids.tolist() == [NONE]
    assert found.reasons == {0: "no instance to compare its time with"}


def test_instances_without_times_are_left_out():
    stamps, trajectories = np.array([np.nan, 1.0]), np.array([0, 1], np.int32)
    found = match_times(np.array([1.0]), stamps, trajectories, 0.1)
    assert found.iids.tolist() == [1]


@given(st.lists(st.integers(0, 6), max_size=20))
def test_the_first_row_of_each_key_counts(keys):
    first, repeated = first_of_each(np.array(keys, dtype=np.int64))
    assert first.tolist() == sorted({key: keys.index(key) for key in keys}.values())
    assert repeated == {row: keys.index(key) for row, key in enumerate(keys)
                        if keys.index(key) != row}  # fmt: skip

"""Projections of few and of many instances, and simultaneous requests for one run name."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.maintenance.verify import verify
from s2rtools.precompute.prediction_rows import decode_split, encode_split
from s2rtools.precompute.run_registration import add_run
from s2rtools.precompute.tasks.umap_projection import SETTINGS, joint_umap, principal_components


@pytest.mark.parametrize("n", [0, 1, 2, 10, 30, 49, 60])
def test_few_instances_have_a_projection(n):
    rng = np.random.default_rng(n)
    sides = rng.normal(size=(2, n, 128)).astype(np.float16)
    valid = np.ones(n, dtype=bool)
    sim, real, _ = principal_components((sides[0], sides[1]), valid)
    assert sim.shape == real.shape == (n, 50)
    for plane in joint_umap((sim, real), valid):
        assert plane.shape == (n, 2)
        assert np.isfinite(plane).all()


@pytest.mark.usefixtures("real_umap")
def test_a_projection_separates_clusters_and_is_repeatable():
    rng = np.random.default_rng(0)
    cluster = np.arange(40) % 2
    sim, real = (rng.normal(20 * cluster[:, None], 1, (40, 5)).astype(np.float32) for _ in "ab")
    valid = np.arange(40) != 7
    settings = replace(SETTINGS, fit_instances=60)
    planes = joint_umap((sim, real), valid, settings)
    again = joint_umap((sim, real), valid, settings)
    for plane, repeated in zip(planes, again, strict=True):
        np.testing.assert_array_equal(plane, repeated)
        assert np.isnan(plane[7]).all()
        first, second = plane[valid & (cluster == 0)], plane[valid & (cluster == 1)]
        centres = np.linalg.norm(first.mean(0) - second.mean(0))
        assert centres > 3 * max(first.std(0).max(), second.std(0).max())
    assert np.linalg.norm(planes[0][valid].mean(0) - planes[1][valid].mean(0)) < centres


def test_without_valid_instances_there_is_no_projection():
    side = np.ones((5, 16), np.float16)
    sim, _, _ = principal_components((side, side), np.zeros(5, bool))
    assert np.isnan(sim).all()


def test_a_run_name_is_assigned_once(store_copy):
    def add(_: int) -> bool:
        try:
            add_run(store_copy, "dup", "vanilla", None, None, {"sim": [], "real": []})
        except RequestError:
            return False
        return True

    with ThreadPoolExecutor(3) as pool:
        assert sorted(pool.map(add, range(3))) == [False, False, True]
    with s2rstore.open(store_copy) as store:
        assert store.execute("SELECT count(*) FROM run WHERE run = 'dup'") == [(1,)]
    assert verify(store_copy) == []


def test_a_split_is_that_of_its_data_set_and_what_was_appended_is_unseen():
    codes = np.array([0, 0, 1, 2], np.int8)
    assert decode_split(encode_split(codes), 6).tolist() == [0, 0, 1, 2, 3, 3]
    assert decode_split("[]", 0).size == 0
    with pytest.raises(RequestError, match="4 instances"):
        decode_split(encode_split(codes), 3)

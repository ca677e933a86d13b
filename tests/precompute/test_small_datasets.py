"""Data sets with few instances, and simultaneous requests for one run name."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.maintenance.verify import verify
from s2rtools.precompute.prediction_rows import decode_split, encode_split
from s2rtools.precompute.run_registration import add_run
from s2rtools.precompute.tasks.umap_projection import joint_umap, principal_components


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

"""The joint projection of both sides by umap-learn itself."""

from dataclasses import replace

import numpy as np
import pytest

from s2rtools.precompute.tasks.umap_projection import SETTINGS, joint_umap


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

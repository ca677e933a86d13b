"""Synthetic drives with known parameters."""

import numpy as np
import pytest

from s2rstore.geometry.angles import wrap
from s2rtools.sysid.synthetic_drives import DriveSettings, make_drives

SHORT = DriveSettings(count=2, seconds=4.0)


def test_without_severity_only_the_measurement_noise_differs(tmp_path):
    for drive in make_drives(tmp_path, 5, {"latency": 0.0, "wheels": 0.0}, SHORT):
        differences = np.concatenate([drive.real.x - drive.sim.x, drive.real.y - drive.sim.y])
        heading_differences = wrap(drive.real.heading - drive.sim.heading)
        assert differences.std() == pytest.approx(SHORT.place_noise, rel=0.2)
        assert heading_differences.std() == pytest.approx(SHORT.heading_noise, rel=0.2)


@pytest.mark.parametrize("factor", ["latency", "wheels"])
def test_a_factor_affects_only_the_real_robot(tmp_path, factor):
    without_factor = make_drives(tmp_path / "even", 5, {}, SHORT)
    with_factor = make_drives(tmp_path / "odd", 5, {factor: 1.0}, SHORT)
    for a, b in zip(without_factor, with_factor, strict=True):
        np.testing.assert_array_equal(a.sim.x, b.sim.x)
        assert np.hypot(a.real.x - b.real.x, a.real.y - b.real.y).max() > 0.01

"""APE and RPE compared with evo and with their definitions."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.support import robot
from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.gap.dynamics import ape_rpe
from s2rtools.gap.dynamics.ape_rpe import LogAlignment, RpeStep
from s2rtools.motion_logs import Log
from s2rtools.motion_logs.motion_log import RigidTransform, fit_transform

metrics = pytest.importorskip("evo.core.metrics")
trajectory = pytest.importorskip("evo.core.trajectory")

DRIVE = robot.pair(2, gain=0.93, turn_gain=1.04, noise=0.004, turn_noise=0.01, seconds=12.0)
MOVED = RigidTransform(0.4, x=3.0, y=-1.0, scale=1.1)


def evo_trajectory(log: Log):
    half = log.heading / 2
    zero = np.zeros(half.size)
    return trajectory.PoseTrajectory3D(
        np.stack([log.x, log.y, zero], axis=1),
        np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1),
        log.time,
    )


ALIGNMENTS = [
    (LogAlignment(), None),
    (LogAlignment(rigid=True), {}),
    (LogAlignment(rigid=True, scale=True), {"correct_scale": True}),
]


def resampled(evo_align: dict | None):
    """Reference and estimate on the times of the reference, aligned by evo."""
    real, sim = ape_rpe.resample_pair(DRIVE.real, MOVED(DRIVE.sim))
    reference, estimate = evo_trajectory(real), evo_trajectory(sim)
    if evo_align is not None:
        estimate.align(reference, **evo_align)
    return reference, estimate


def assert_errors_of_evo(errors, metric_of, pair) -> None:
    """Compare the errors of positions and headings with those of a metric of evo."""
    relations = metrics.PoseRelation.translation_part, metrics.PoseRelation.rotation_angle_rad
    for relation, computed in zip(relations, (errors.position, errors.heading), strict=True):
        evo_metric = metric_of(relation)
        evo_metric.process_data(pair)
        assert computed == pytest.approx(evo_metric.error, abs=1e-7)
        rmse = evo_metric.get_statistic(metrics.StatisticsType.rmse)
        assert ape_rpe.rmse(computed) == pytest.approx(rmse)


@pytest.mark.parametrize(("alignment", "evo_align"), ALIGNMENTS)
def test_ape_equals_evo(alignment, evo_align):
    errors = ape_rpe.ape(DRIVE.real, MOVED(DRIVE.sim), alignment)
    assert_errors_of_evo(errors, metrics.APE, resampled(evo_align))


@pytest.mark.parametrize(
    ("step", "poses"), [(RpeStep(0.5), 25), (RpeStep(poses=100), 100), (RpeStep(2.0), 100)]
)
@pytest.mark.parametrize(("alignment", "evo_align"), ALIGNMENTS)
def test_rpe_equals_evo(step, poses, alignment, evo_align):
    errors = ape_rpe.rpe(DRIVE.real, MOVED(DRIVE.sim), step, alignment)
    metric_of = partial(metrics.RPE, delta=poses, delta_unit=metrics.Unit.frames, all_pairs=True)
    assert_errors_of_evo(errors, metric_of, resampled(evo_align))


@given(
    st.floats(-np.pi, 3.14), st.booleans(), st.floats(0.2, 5), st.floats(-1e3, 1e3),
    st.floats(-1e3, 1e3), st.booleans(),
)  # fmt: skip
def test_alignment_removes_any_similarity_transform(angle, reflected, scale, x, y, scaled):
    log = DRIVE.sim
    moved = RigidTransform(angle, reflected, scale if scaled else 1.0, x, y)(log)
    error = ape_rpe.ape(log, moved, LogAlignment(True, reflection=True, scale=scaled))
    assert error.position.max() < 1e-6
    assert error.heading.max() < 1e-6


def test_a_mirrored_log_is_aligned_only_by_a_reflection():
    mirrored = RigidTransform(1.0, reflected=True)(DRIVE.sim)
    turned = ape_rpe.ape(DRIVE.sim, mirrored, LogAlignment(rigid=True))
    assert ape_rpe.rmse(turned.position) > 0.3
    assert not fit_transform((DRIVE.sim.x, DRIVE.sim.y), (DRIVE.sim.x, DRIVE.sim.y), True).reflected


def test_headings_are_interpolated_across_the_wrap():
    time = np.arange(3.0)
    sim = Log(time, time, time, np.array([3.1, -3.1, -3.0]), "", "")
    real = Log(time + 0.5, time, time, np.full(3, np.pi), "", "")
    heading_errors = ape_rpe.ape(real, sim).heading
    assert heading_errors[0] == pytest.approx(0.0, abs=1e-9)
    assert angles.distance(-3.05, np.pi) == pytest.approx(heading_errors[1])


def test_scales_are_path_lengths():
    log = Log(np.arange(5.0), 3 * np.arange(5.0), 4 * np.arange(5.0), np.zeros(5), "", "")
    assert ape_rpe.SCALES["extent"](log, 1.0) == pytest.approx(20.0)
    assert ape_rpe.SCALES["travel"](log, 2.0) == pytest.approx(10.0)
    errors = np.array([3.0, 4.0, 0.0, 5.0])
    assert ape_rpe.rmse(errors) == pytest.approx(np.sqrt(12.5))


def test_travel_is_independent_of_noise():
    rng = np.random.default_rng(0)
    exact = robot.drive(robot.commands(30.0, rng))
    without_noise, noisy = (robot.sampled(exact, 50.0, n, 0.0, rng) for n in (0.0, 0.01))
    assert ape_rpe.travel(noisy, 1.0) == pytest.approx(ape_rpe.travel(without_noise, 1.0), rel=0.01)


def test_invalid_requests_are_explained():
    with pytest.raises(RequestError, match="need rigid"):
        ape_rpe.ape(DRIVE.real, DRIVE.sim, LogAlignment(scale=True))
    with pytest.raises(RequestError, match="no two poses are 99 s apart"):
        ape_rpe.rpe(DRIVE.real, DRIVE.sim, RpeStep(99.0))
    with pytest.raises(RequestError, match="later do not overlap"):
        ape_rpe.ape(DRIVE.real, replace(DRIVE.sim, time=DRIVE.sim.time + 99, source="later"))

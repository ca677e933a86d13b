"""Options of the dynamics and delay axes, and the odometry of a store as drives."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from bench.support import robot
from s2rstore.index.transaction import edit
from s2rtools.common.command_line.assignments import parse_assignments
from s2rtools.gap.axes import MOTION, configured, options_of
from s2rtools.gap.axis import Evidence, GapSettings
from s2rtools.gap.delay.delay_axis import DelayAxis
from s2rtools.gap.dynamics.ape_rpe import LogAlignment, RpeStep
from s2rtools.gap.dynamics.dynamics_axis import DynamicsAxis
from s2rtools.gap.dynamics.noise_floor import Noise
from s2rtui.cli import main

SETTINGS = GapSettings()


@pytest.fixture(scope="module")
def evidence(tiny_store: Path):
    with s2rstore.open(tiny_store) as store:
        yield lambda *drives: Evidence(store, "vanilla", np.arange(3), drives=drives)


def parse_axes(*arguments: str) -> tuple[DynamicsAxis, DelayAxis]:
    both = configured(parse_assignments(MOTION, arguments, options_of(MOTION)))
    dynamics, delay = both["dynamics"], both["delay"]
    assert isinstance(dynamics, DynamicsAxis)
    assert isinstance(delay, DelayAxis)
    return dynamics, delay


def test_every_option_is_passed_to_its_axis():
    dynamics, delay = parse_axes(
        "horizons=1,2", "nrmse=deviation", "align=rigid+scale", "rpe=25", "reach=0.5",
        "bad=period", "period=0.1", "noise=0.002,0.003",
    )  # fmt: skip
    assert dynamics.plan.horizons == (1.0, 2.0)
    assert dynamics.plan.stride == 0.5
    assert dynamics.scale == "deviation"
    assert dynamics.alignment == LogAlignment(rigid=True, scale=True)
    assert dynamics.rpe_step == RpeStep(poses=25)
    assert dynamics.noise == Noise(0.002, 0.003)
    assert (dynamics.max_delay, delay.max_delay) == (0.5, 0.5)
    assert (delay.bad_state, delay.period) == ("period", 0.1)


def test_no_options_give_the_defaults():
    dynamics, delay = parse_axes()
    for axis, default in ((dynamics, DynamicsAxis()), (delay, DelayAxis())):
        assert vars(axis) == vars(default)
    assert vars(parse_axes("align=none", "noise=measured", "rpe=1s")[0]) == vars(DynamicsAxis())


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["horizon=1"], "--dynamics horizon=1: expected NAME=VALUE with NAME one of horizons, "),
        (["horizons=1", "horizons=2"], "horizons is repeated"),
        (["horizons=1,x"], "--dynamics horizons=1,x: expected seconds"),
        (["horizons=2,1"], "must be positive and increasing"),
        (["horizons=0"], "expected seconds above 0"),
        (["nrmse=metres"], "--dynamics nrmse=metres: expected one of travel, extent, deviation"),
        (["align=scale"], "expected none, or rigid with"),
        (["rpe=1.5"], "expected seconds such as 1s, or a number of poses"),
        (["reach=inf"], "expected seconds up to 60"),
        (["bad=today"], "expected one of period, untuned"),
        (["period=0"], "expected seconds such as 0.05"),
        (["noise=0.1"], "expected measured, or metres and radians"),
    ],
)
def test_invalid_options_are_reported_before_opening_the_store(tmp_path, s2r, arguments, expected):
    cli_options = [part for argument in arguments for part in ("--dynamics", argument)]
    s2r("gap", tmp_path / "no.s2r", *cli_options).assert_refused(expected)


def test_the_fingerprint_contains_only_options_that_affect_the_measure(evidence):
    drives_evidence = evidence(robot.pair(1, seconds=12.0, gain=0.9))
    default = parse_axes("horizons=0.5,1")[0].measure(drives_evidence, SETTINGS)
    for option in ("nrmse=extent", "nrmse=deviation", "noise=0.01,0.01", "reach=0.5"):
        other = parse_axes("horizons=0.5,1", option)[0].measure(drives_evidence, SETTINGS)
        assert other.fingerprint != default.fingerprint
        assert (other.value == default.value) == option.startswith("reach")
    for option in ("align=rigid+reflection+scale", "rpe=2s"):
        other = parse_axes("horizons=0.5,1", option)[0].measure(drives_evidence, SETTINGS)
        assert (other.value, other.fingerprint) == (default.value, default.fingerprint)
        assert other.details["drives"] != default.details["drives"]


def drive_row(evidence: Evidence, *arguments: str) -> dict:
    """The figures of the only drive, compared as a whole."""
    axis = parse_axes("horizons=0.5,1", *arguments)[0]
    return axis.measure(evidence, SETTINGS).details["drives"][0]


def test_a_missing_rpe_step_gives_an_unknown_rpe(evidence):
    row = drive_row(evidence(robot.pair(1, seconds=12.0)), "rpe=99s")
    assert row["rpe_rmse"] is None
    assert row["ape_rmse"] > 0


@pytest.fixture
def store_with_odometry(store_copy: Path) -> Path:
    """A store whose trajectory a has odometry in a mirrored frame."""
    with edit(store_copy) as draft:
        draft.rows(
            "UPDATE instance SET odom_x = 3 + 0.9 * y, odom_y = x - 2, odom_heading = "
            "pi() / 2 - heading WHERE trajectory = 'a' RETURNING iid"
        )
    return store_copy


ODOMETRY = ["--drives", "odometry", "--rate", "1", "--axis", "dynamics",
            "--dynamics", "horizons=4", "--dynamics", "noise=0,0"]  # fmt: skip


def test_odometry_can_be_measured_but_not_frozen(store_with_odometry, tmp_path, capsys, s2r):
    assert main(["gap", str(store_with_odometry), *ODOMETRY, "--json"]) == 3
    (axis,) = json.loads(capsys.readouterr().out)["axes"]
    assert axis["details"]["drives"][0]["ape_rmse_recorded"] == pytest.approx(
        best_rigid_rms(store_with_odometry), rel=1e-6
    )
    assert axis["details"]["floor_from"] == "declared noise 0 m, 0 rad"
    aligned = "odometry was first aligned with the ground truth (mirrored, turned by"
    assert any(aligned in note for note in axis["notes"])
    s2r("gap", store_with_odometry, *ODOMETRY, "--freeze", tmp_path / "ref.json").assert_refused(
        "odometry has no untuned simulator as the bad state"
    )
    assert not (tmp_path / "ref.json").exists()


def test_details_describe_the_whole_drive_comparison(store_with_odometry, capsys):
    details = [*ODOMETRY, "--details", "--dynamics", "rpe=2"]
    assert main(["gap", str(store_with_odometry), *details]) == 3
    out = capsys.readouterr().out
    assert "alignment before APE and RPE: none; RPE over 2 poses" in out
    assert "APE as recorded m" in out
    assert "heading degrees" in out


def best_rigid_rms(store: Path) -> float:
    """RMS distance of odometry and truth after the best rigid motion or reflection."""
    with s2rstore.open(store) as opened:
        truth = opened.instances
        has_odometry = np.isfinite(truth.odom_x)
        a = np.stack([truth.odom_x, truth.odom_y])[:, has_odometry]
        b = np.stack([truth.x, truth.y])[:, has_odometry]
    a, b = (points - points.mean(axis=1, keepdims=True) for points in (a, b))
    u, _, v = np.linalg.svd(b @ a.T)
    return float(np.sqrt(((u @ v @ a - b) ** 2).sum(axis=0).mean()))

"""The two axes: they answer to what they are about, and to nothing else."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import InconclusiveError, RequestError
from s2rtools.gap.contract import Anchor, Axis, Evidence, Measured, Settings
from s2rtools.gap.dynamics import Delay, Dynamics
from s2rtools.gap.dynamics.windows import Plan
from s2rtools.logs import Drive
from s2rtools.logs.rigid import Rigid
from tests.support import robot

SETTINGS = Settings(replicates=300)


@pytest.fixture(scope="module")
def evidence(tiny_store: Path):
    """Evidence of the given drives."""
    with s2rstore.open(tiny_store) as store:
        yield lambda drives: Evidence(store, "vanilla", np.arange(3), drives=drives)


def drives(count: int = 1, **real: float) -> list[Drive]:
    return [robot.pair(seed, untuned=0.15, **real) for seed in range(count)]


def gap(measured: Measured, anchor: Anchor) -> tuple[float, float, float]:
    """G in percent with its bounds, from paired replicates."""
    value = (measured.value - measured.floor) / (anchor.value - measured.floor)
    spread = (measured.replicates - measured.floor_replicates) / (
        anchor.replicates - measured.floor_replicates
    )
    low, high = np.percentile(100 * spread, [2.5, 97.5])
    return 100 * value, float(low), float(high)


def judged(axis: Axis, evidence: Evidence) -> tuple[float, float, float]:
    return gap(axis.measure(evidence, SETTINGS), axis.anchor(evidence, SETTINGS))


@pytest.mark.parametrize("count", [1, 3])
def test_without_a_gap_both_are_at_their_floors(evidence, count: int) -> None:
    same = evidence(drives(count, delay=0.0))
    for axis in (Dynamics(), Delay()):
        value, low, high = judged(axis, same)
        assert abs(value) < 1
        assert -2 < low <= high < 2


def test_latency_moves_the_delay_and_not_the_dynamics(evidence) -> None:
    late = evidence(drives(2, delay=0.08))
    measured = Delay().measure(late, SETTINGS)
    assert measured.value == pytest.approx(0.08 / robot.PERIOD, rel=0.02)
    assert measured.details["delay"] == pytest.approx(0.08, abs=1e-3)
    assert measured.details["delay_low"] <= 0.0805
    assert measured.details["delay_high"] >= 0.0795
    assert judged(Dynamics(), late)[2] < 3


def test_wrong_motion_moves_the_dynamics_and_not_the_delay(evidence) -> None:
    slow = evidence(drives(2, delay=0.0, gain=0.85, turn_gain=0.9))
    assert judged(Dynamics(), slow)[1] > 15
    assert judged(Delay(), slow)[2] < 3


def test_the_sign_of_the_delay_is_told(evidence) -> None:
    early = Delay().measure(evidence(drives(1, delay=-0.04)), SETTINGS)
    assert early.details["delay"] == pytest.approx(-0.04, abs=1e-3)
    assert early.value == pytest.approx(0.8, rel=0.05)
    assert early.floor < 0.05


def test_nrmse_of_a_known_error(evidence) -> None:
    plan = Plan(horizons=(0.5, 1.0))
    measured = Dynamics(plan).measure(
        evidence(drives(1, delay=0.0, gain=0.9, noise=0.0, turn_noise=0.0)), SETTINGS
    )
    assert measured.value == pytest.approx(1 / 0.9 - 1, rel=0.1)
    assert measured.floor < 0.005
    rows = measured.details["horizons"]
    assert [row["horizon"] for row in rows] == [0.5, 1.0]
    for row in rows:
        assert row["nrmse"] == pytest.approx(row["rmse"] / row["scale"])
        assert row["nrmse_low"] < row["nrmse"] < row["nrmse_high"]
    assert measured.value == pytest.approx(np.mean([row["nrmse"] for row in rows]))
    assert measured.n == sum(row["windows"] for row in rows)


def test_the_scale_is_declared_and_stored(evidence) -> None:
    same = evidence(drives(1, gain=0.9))
    travel, extent = (Dynamics(scale=s).measure(same, SETTINGS) for s in ("travel", "extent"))
    assert travel.fingerprint["scale"] == "travel"
    assert extent.fingerprint["scale"] == "extent"
    assert extent.details["horizons"][0]["scale"] == extent.details["horizons"][1]["scale"]
    assert travel.value != pytest.approx(extent.value)
    with pytest.raises(RequestError, match="scale metres"):
        Dynamics(scale="metres")


def test_repeated_real_drives_are_the_floor(evidence) -> None:
    told = robot.commands(30.0, np.random.default_rng(0))
    sim = robot.sampled(robot.drive(told))
    made = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        real = robot.sampled(robot.drive(told, slip=0.02, rng=rng), 50, 0.001, 0.001, rng)
        later = replace(told, time=told.time + 100 * seed)
        real, other = (replace(log, time=log.time + 100 * seed) for log in (real, sim))
        made.append(Drive(f"d{seed}", real, other, None, later))
    repeated = Dynamics().measure(evidence(made), SETTINGS)
    assert repeated.fingerprint["floor_from"] == "repeated real drives"
    alone = Dynamics().measure(evidence(made[:1]), SETTINGS)
    assert alone.fingerprint["floor_from"] == "noise of the poses"
    assert repeated.floor > 2 * alone.floor
    assert repeated.floor > repeated.value
    mixed = Dynamics().measure(evidence([*made, robot.pair(9)]), SETTINGS)
    assert mixed.fingerprint["floor_from"] == "mixed"


def test_rows_of_measure_floor_and_anchor_are_one_resample(evidence) -> None:
    some = evidence(drives(3, gain=0.9))
    measured = Dynamics().measure(some, SETTINGS)
    same = [replace(d, untuned=d.sim) for d in some.drives]
    anchor = Dynamics().anchor(evidence(same), SETTINGS)
    assert anchor.value == pytest.approx(measured.value)
    assert anchor.replicates == pytest.approx(measured.replicates)
    assert measured.replicates.shape == measured.floor_replicates.shape == (300,)


def test_the_bad_state_of_the_delay_may_be_a_period(evidence) -> None:
    some = evidence(drives(1))
    assert Delay().anchor(some, SETTINGS).value > 3
    whole = Delay(bad_state="period").anchor(some, SETTINGS)
    assert whole.value == 1.0
    assert whole.replicates.tolist() == [1.0] * 300


def test_what_is_missing_is_said(evidence) -> None:
    none = evidence([])
    assert "no drives" in (Dynamics().missing(none) or "")
    assert "no drives" in (Delay().missing(none) or "")
    quiet = evidence([replace(robot.pair(1), commands=None)])
    assert Dynamics().missing(quiet) is None
    assert "commands.csv" in (Delay().missing(quiet) or "")
    assert Delay(period=0.1).missing(quiet) is None
    assert Delay(period=0.1).measure(quiet, SETTINGS).value == pytest.approx(0.3, rel=0.1)
    for axis in (Dynamics(), Delay()):
        with pytest.raises(RequestError, match=r"drive drive1 has no untuned\.\*"):
            axis.anchor(evidence([robot.pair(1)]), SETTINGS)


def test_unequal_periods_and_short_drives_are_refused(evidence) -> None:
    a, b = drives(2)
    assert b.commands is not None
    other = replace(b, commands=replace(b.commands, period=0.1))
    with pytest.raises(RequestError, match=r"0\.05 s in drive drive0, 0\.1 s in drive1"):
        Delay().measure(evidence([a, other]), SETTINGS)
    short = evidence([robot.pair(1, seconds=5.0)])
    with pytest.raises(InconclusiveError, match=r"windows of 5 s in the drives, 8 are needed"):
        Dynamics().measure(short, SETTINGS)


def plain(value: object) -> bool:
    return json.loads(json.dumps(value)) == value


def test_details_are_plain_data_and_fingerprints_agree_with_themselves(evidence) -> None:
    some: Sequence[Drive] = drives(2)
    for axis in (Dynamics(), Delay()):
        first, second = (axis.measure(evidence(some), SETTINGS) for _ in range(2))
        assert plain(first.details)
        assert plain(dict(first.fingerprint))
        assert first.fingerprint == second.fingerprint
        longer = axis.measure(evidence([*some, *drives(3)[2:]]), SETTINGS)
        assert longer.n > first.n
        assert longer.fingerprint == first.fingerprint
        assert (first.replicates == second.replicates).all()
        assert np.isfinite(first.replicates).all()


def test_a_mirrored_log_is_told(evidence) -> None:
    (drive,) = drives(1, delay=0.0)
    mirrored = replace(drive, sim=Rigid(reflected=True)(drive.sim))
    told = Dynamics().measure(evidence([mirrored]), SETTINGS)
    assert any("mirrored frame" in note for note in told.notes)
    assert told.value > 10 * told.floor
    assert not any("mirrored" in n for n in Dynamics().measure(evidence([drive]), SETTINGS).notes)

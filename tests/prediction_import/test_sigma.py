"""Sigmas of imported predictions: columns, selections, calibration, risk and radii."""

from __future__ import annotations

import json
import math
import statistics
from fractions import Fraction
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import s2rstore
from s2rstore.index import row_files
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.maintenance.verify import verify
from s2rstore.metrics.uncertainty import conformal_radius
from s2rstore.records import SIDES
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtui.cli import main
from tests.support.predictions import make, write_rows
from tests.support.refusals import run_command
from tests.support.silent_reporter import SilentReporter

NAMES = ("iid", "side", "x", "y", "heading", "sigma")


def import_file(store, file, *words):
    command = ["run", "import", "theirs", "--predictions", str(file), "--store", str(store)]
    assert main([*command, *words]) == 0


def rows_of(store, scale=1.0):
    """Predictions of both sides in metres over `scale`: some have no pose, some no sigma."""
    made, rng = make(store), np.random.default_rng(3)
    rows = []
    for side in SIDES:
        for iid, (x, y, heading) in enumerate(made.of(side)):
            sigma = "" if iid % 5 == 1 else round(rng.uniform(0.05, 0.5), 1) / scale
            pose = ("", "nan", "") if iid % 7 == 3 and side == "real" else (x / scale, y / scale,
                                                                            heading)  # fmt: skip
            rows.append((iid, side, *pose, sigma))
    return rows


@pytest.mark.parametrize("in_files", [False, True])
def test_a_sigma_is_stored_selected_and_kept(store, tmp_path, monkeypatch, capsys, in_files):
    if in_files:
        monkeypatch.setattr(row_files, "MAX_ROWS", 0)
    rows = rows_of(store, scale=0.001)
    import_file(store, write_rows(tmp_path / "p.csv", NAMES, rows), "--units", "mm,rad")
    assert "with a sigma, median 0." in capsys.readouterr().out
    expected = {(iid, side): 0.001 * s if s and x else None for iid, side, x, _, _, s in rows}
    for is_computed in (False, True):
        with s2rstore.open(store) as opened:
            assert bool(opened.row_files) == in_files
            stored = opened.execute("SELECT iid, side, sigma FROM prediction")
            assert {(iid, side): sigma for iid, side, sigma in stored} == pytest.approx(expected)
            for text in ("real.sigma > 0.25 | sim.sigma_m < 0.2", "worst(5, real.sigma)"):
                mask = evaluation.select(opened, text, run="theirs")
                query, parameters = evaluation.sql(opened, text, "theirs")
                found = [iid for (iid,) in opened.execute(query, parameters)]
                assert found == np.flatnonzero(mask).tolist() != []
        if not is_computed:
            options = PrecomputeOptions(("pixel_difference",))
            assert precompute(store, SilentReporter(), ["theirs"], options) == ["theirs"]
    capsys.readouterr()
    columns = ("--columns", "iid,sim.sigma,real_sigma_m")
    assert main(["query", str(store), "all", "--run", "theirs", *columns, "--json"]) == 0
    for row in json.loads(capsys.readouterr().out):
        assert row["sim.sigma"] == pytest.approx(expected[row["iid"], "sim"])
        assert row["real_sigma_m"] == pytest.approx(expected[row["iid"], "real"])
    assert verify(store) == []


def test_a_row_of_both_sides_has_two_sigmas_in_metres(store, tmp_path):
    made = make(store)
    names = [f"{side}_{name}" for side in SIDES for name in ("x", "y", "heading", "sigma_m")]
    rows = [
        (iid, *(1000 * made.sim[iid, :2]), made.sim[iid, 2], 0.1,
         *(1000 * made.real[iid, :2]), made.real[iid, 2], 0.2)
        for iid in range(24)
    ]  # fmt: skip
    file = write_rows(tmp_path / "p.csv", ["iid", *names], rows)
    import_file(store, file, "--units", "mm,rad")
    with s2rstore.open(store) as opened:
        found = opened.execute("SELECT DISTINCT sim_sigma_m, real_sigma_m FROM pair")
        assert found == [(0.1, 0.2)]


@pytest.mark.parametrize("text", ["0", "-0.1", "inf", "unsure"])
def test_other_sigmas_are_refused_by_file_and_row(store, tmp_path, capsys, text):
    rows = rows_of(store)
    rows[4] = (*rows[4][:5], text)
    file = write_rows(tmp_path / "p.csv", NAMES, rows)
    command = ("run", "import", "theirs", "--predictions", file, "--store", store)
    found = run_command(capsys, *command)
    found.assert_refused("p.csv:6", "sigma", text, "must be a finite number above 0, or empty")
    with s2rstore.open(store) as opened:
        assert not opened.runs


def slow_radius(values, units):
    """The radius by its definition, in exact numbers; None where there are too few units."""
    sizes = {unit: units.count(unit) for unit in units}
    for radius in sorted(values):
        held = [Fraction(1, (len(sizes) + 1) * sizes[unit])
                for value, unit in zip(values, units, strict=True) if value <= radius]  # fmt: skip
        if sum(held) >= Fraction(9, 10):
            return radius
    return None


def slow_aurc(errors, keys):
    """Mean over n of the mean error of the n smallest keys; equal keys by their mean error."""
    pairs = sorted(zip(keys, errors, strict=True))
    ordered = []
    for _, group in groupby(pairs, key=lambda pair: pair[0]):
        members = [error for _, error in group]
        ordered += [sum(members) / len(members)] * len(members)
    means = [sum(ordered[:count]) / count for count in range(1, len(ordered) + 1)]
    return sum(means) / len(means), means


@pytest.fixture
def table(store, tmp_path, capsys):
    """Rows of the risk table by side, figure and what it is of; and those of view `pair` by side.

    The latter are trajectory, room, error and sigma of each instance in recording order.
    """
    import_file(store, write_rows(tmp_path / "p.csv", NAMES, rows_of(store)))
    with edit(store) as draft:  # visits of one and of two instances, some of them in no room
        draft._connection.execute(
            "UPDATE instance SET room = CASE WHEN iid // 2 % 4 = 3 THEN NULL "
            "WHEN iid % 2 = 0 THEN 'west' ELSE 'east' END"
        )
    columns = "trajectory, room, {0}_error_m, {0}_sigma_m"
    with s2rstore.open(store) as opened:
        rows = {
            side: opened.execute(f"SELECT {columns.format(side)} FROM pair ORDER BY iid")
            for side in SIDES
        }
    capsys.readouterr()
    assert main(["show", str(store), "risk", "--run", "theirs", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    names = [f"{row['figure']} {row['unit'] or ''}".strip() for row in shown]
    keys = [(row["side"], name, row["of"]) for row, name in zip(shown, names, strict=True)]
    return dict(zip(keys, shown, strict=True)), rows


@pytest.mark.parametrize("side", SIDES)
def test_calibration_and_risk_equal_a_slow_computation(table, side):
    shown = {key[1:]: row for key, row in table[0].items() if key[0] == side}
    stated = [row for row in table[1][side] if row[2] is not None and row[3] is not None]
    errors, sigmas = ([row[place] for row in stated] for place in (2, 3))
    ratios = [error / sigma for error, sigma in zip(errors, sigmas, strict=True)]
    n = len(ratios)
    for p in (0.5, 0.68, 0.8, 0.9, 0.95):
        row = shown["within %", f"p {p:g}"]
        held = sum(ratio <= stats.rayleigh.ppf(p) for ratio in ratios)
        assert (row["value"], row["n"]) == (pytest.approx(100 * held / n), n)
        assert 0 <= row["low"] <= row["value"] <= row["high"] <= 100
    factor = shown["factor of sigma", None]
    assert factor["value"] == pytest.approx(statistics.median(ratios) / stats.rayleigh.median())
    assert factor["reason"] == f"n {n}, a median needs 25"
    area, means = slow_aurc(errors, sigmas)
    best = slow_aurc(errors, errors)[0]
    areas = {None: area, "best order": best, "random order": means[-1]}
    for order, value in areas.items():
        assert shown["AURC m", order]["value"] == pytest.approx(value)
    for share in (0.1, 0.25, 0.5, 0.75, 0.9, 1):
        row = shown["mean error m", f"most certain {100 * share:g} %"]
        assert row["value"] == pytest.approx(means[math.ceil(share * n) - 1])


@pytest.mark.parametrize("side", SIDES)
def test_radii_equal_a_slow_computation(table, side):
    shown, rows = table[0], table[1][side]
    visits = []
    for number, (_, group) in enumerate(groupby(rows, key=lambda row: row[:2])):
        visits += [number] * len(list(group))
    kinds = set()
    for room in ("all rooms", "west", "east", "no room"):
        name = None if room == "no room" else room
        inside = [k for k in range(24) if room == "all rooms" or rows[k][1] == name]
        metres = [(math.inf if rows[k][2] is None else rows[k][2], visits[k]) for k in inside]
        in_sigmas = [
            (rows[k][2] / rows[k][3], visits[k]) for k in inside
            if rows[k][2] is not None and rows[k][3] is not None
        ]  # fmt: skip
        for figure, pairs in (("radius m", metres), ("radius sigmas", in_sigmas)):
            values, units = map(list, zip(*pairs, strict=True))
            expected, row = slow_radius(values, units), shown[side, figure, room]
            assert row["detail"].split()[0] == str(len(set(units)))
            assert row["n"] == len(values)
            if expected is None:
                reason = f"no radius: {len(set(units))} visits, 9 are needed"
                assert (row["value"], row["reason"]) == (None, reason)
            elif math.isinf(expected):
                assert row["reason"] == "no radius: too many instances are not localised"
            else:
                assert (row["value"], row["reason"]) == (pytest.approx(expected), None)
            kinds.add(expected if expected is None else math.isinf(expected))
    assert kinds >= {None, False}
    assert (True in kinds) == (side == "real")


def test_without_sigmas_there_are_radii_alone(tiny_store, s2r):
    rows = s2r("show", tiny_store, "risk", "--select", "real.error < 9", "--json").json
    assert {row["figure"] for row in rows} == {"factor of sigma", "radius"}
    reasons = {row["reason"] for row in rows}
    assert "no sigma: the predictions carry none" in reasons
    assert any(text.startswith("no radius: ") and text.endswith("9 are needed") for text in reasons)
    assert (
        "no sigma: the predictions carry none" in s2r("show", tiny_store, "risk", "--words").printed
    )


VALUES = st.lists(
    st.tuples(st.floats(0, 100), st.integers(0, 14), st.floats(0, 5)), min_size=1, max_size=60
)


@given(VALUES)
def test_larger_values_and_a_higher_probability_give_no_smaller_radius(rows):
    values, units, more = (np.array(column) for column in zip(*rows, strict=True))
    radius = conformal_radius(values, units)
    expected = slow_radius(values.tolist(), units.tolist())
    assert bool(radius.reason) == (len(set(units.tolist())) < 9) == (expected is None)
    if not radius.reason:
        assert radius.value == expected
        assert conformal_radius(values + more, units).value >= radius.value
        assert conformal_radius(values, units, alpha=0.2).value <= radius.value

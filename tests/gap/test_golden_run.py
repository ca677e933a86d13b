"""Comparison with a golden run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import s2rstore
from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.metrics.run_metrics import population
from s2rtools.gap.axis import Evidence, GapSettings
from s2rtools.gap.gate import golden_run

SETTINGS = GapSettings()


@pytest.fixture(scope="module")
def evidence(store_of_400: Path) -> Iterator[Evidence]:
    with s2rstore.open(store_of_400) as store:
        yield Evidence(store, "vanilla", np.arange(400))


def test_the_same_state_passes(evidence, tmp_path):
    (tmp_path / "g.json").write_text(golden_run.text(golden_run.take(evidence)))
    comparison = golden_run.compare(evidence, golden_run.read(tmp_path / "g.json"), SETTINGS)
    assert comparison.outcome == "PASS"
    assert comparison.change.value == comparison.change.low == comparison.change.high == 0
    assert comparison.n == int(population(evidence.store, "vanilla").sum()) == 80


@pytest.mark.parametrize(("shift", "outcome"), [(0.3, "FAIL"), (-0.3, "PASS"), (0.05, None)])
def test_a_change_beyond_the_margin_fails(evidence, shift, outcome):
    """The earlier errors are smaller by `shift`, with noise."""
    rng = np.random.default_rng(0)
    current = golden_run.take(evidence)
    earlier = {iid: error - shift + rng.normal(0, 0.05) for iid, error in current.errors.items()}
    comparison = golden_run.compare(evidence, structs.replace(current, errors=earlier), SETTINGS)
    assert comparison.change.value == pytest.approx(shift, abs=0.03)
    assert comparison.outcome == (outcome or "INCONCLUSIVE")


@pytest.mark.parametrize(
    ("change", "expected"),
    [({"poses": "f" * 64}, "other poses than the golden run"),
     ({"expression": "best15"}, "the golden run is of 'best15', not of 'all'")],
)  # fmt: skip
def test_other_poses_and_selections_are_rejected(evidence, change, expected):
    other = structs.replace(golden_run.take(evidence), **change)
    with pytest.raises(RequestError, match=expected):
        golden_run.compare(evidence, other, SETTINGS)


def test_few_shared_instances_are_inconclusive(evidence):
    taken = golden_run.take(evidence)
    few = structs.replace(taken, errors=dict(list(taken.errors.items())[:5]))
    comparison = golden_run.compare(evidence, few, SETTINGS)
    assert comparison.outcome == "INCONCLUSIVE"
    assert comparison.reason == "5 instances are common to both runs, 49 are needed"
    with pytest.raises(InconclusiveError, match="49 held-out instances"):
        golden_run.take(replace(evidence, iids=np.arange(5)))


@pytest.mark.parametrize(("remaining", "outcome"), [(390, "PASS"), (300, "INCONCLUSIVE")])
def test_many_missing_instances_cannot_pass(evidence, remaining, outcome):
    part = replace(evidence, iids=np.arange(remaining))
    comparison = golden_run.compare(part, golden_run.take(evidence), SETTINGS)
    assert (comparison.n, comparison.missing) == (remaining // 5, 80 - remaining // 5)
    assert comparison.outcome == outcome
    assert (outcome == "PASS") == (not comparison.reason)


def test_missing_instances_do_not_hide_a_failure(evidence):
    current = golden_run.take(evidence)
    rng = np.random.default_rng(0)
    smaller = {iid: error - 1 + rng.normal(0, 0.1) for iid, error in current.errors.items()}
    earlier = structs.replace(current, errors=smaller)
    part = replace(evidence, iids=np.arange(300))
    assert golden_run.compare(part, earlier, SETTINGS).outcome == "FAIL"


@pytest.mark.parametrize(
    "content",
    ["", "{}", "[]", '{"format": 1}', '{"format": 2, "errors": {}}',
     '{"format": 1, "errors": {"a": 1}, "poses": "x", "run": "r", "expression": "all"}',
     '{"format": 1, "errors": {"1": NaN}, "poses": "x", "run": "r", "expression": "all"}',
     '{"format": 1, "errors": {}, "poses": "x", "run": "r", "expression": "all"}',
     '{"format": 1, "errors": {"1": -1}, "poses": "x", "run": "r", "expression": "all"}',
     '{"format": 1, "errors": {"1": 1e308}, "poses": "x", "run": "r", "expression": "all"}',
     pytest.param(f'{{"format": 1, "errors": {{"1": {10**400}}}}}', id="huge"),
     pytest.param("[" * 100_000, id="deep")],
)  # fmt: skip
def test_an_invalid_golden_run_file_is_rejected(tmp_path, content):
    path = tmp_path / "g.json"
    path.write_text(content)
    with pytest.raises(RequestError, match=r"g\.json"):
        golden_run.read(path)

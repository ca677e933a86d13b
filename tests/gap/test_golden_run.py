"""No worse than an accepted state."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import s2rstore
from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.metrics.run_metrics import held_out
from s2rtools.gap.axis_result import Evidence, GapSettings
from s2rtools.gap.gate import golden_run

SETTINGS = GapSettings(replicates=300)


@pytest.fixture(scope="module")
def evidence(store_of_200: Path) -> Iterator[Evidence]:
    with s2rstore.open(store_of_200) as store:
        yield Evidence(store, "vanilla", np.arange(200))


def test_the_same_state_is_no_worse(evidence: Evidence, tmp_path: Path) -> None:
    (tmp_path / "g.json").write_text(golden_run.text(golden_run.take(evidence)))
    found = golden_run.compare(evidence, golden_run.read(tmp_path / "g.json"), SETTINGS)
    assert found.outcome == "PASS"
    assert found.change.value == found.change.low == found.change.high == 0
    assert found.n == int(held_out(evidence.store, "vanilla").sum()) == 40


def test_instances_that_were_trained_on_do_not_count(evidence: Evidence) -> None:
    taken = set(golden_run.take(evidence).errors)
    known = set(np.flatnonzero(~held_out(evidence.store, "vanilla")).tolist())
    assert known
    assert taken.isdisjoint(known)


@pytest.mark.parametrize(("shift", "outcome"), [(0.3, "FAIL"), (-0.3, "PASS"), (0.05, None)])
def test_a_change_beyond_the_margin_fails(
    evidence: Evidence, shift: float, outcome: str | None
) -> None:
    """Earlier errors that were smaller by `shift`, to within noise."""
    rng = np.random.default_rng(0)
    now = golden_run.take(evidence)
    before = {iid: error - shift + rng.normal(0, 0.05) for iid, error in now.errors.items()}
    found = golden_run.compare(evidence, structs.replace(now, errors=before), SETTINGS)
    assert found.change.value == pytest.approx(shift, abs=0.03)
    assert found.outcome == (outcome or "INCONCLUSIVE")


def test_other_poses_are_refused(evidence: Evidence) -> None:
    other = structs.replace(golden_run.take(evidence), poses="f" * 64)
    with pytest.raises(RequestError, match="other poses than the golden run"):
        golden_run.compare(evidence, other, SETTINGS)


def test_another_selection_is_refused(evidence: Evidence) -> None:
    other = structs.replace(golden_run.take(evidence), expression="best15")
    with pytest.raises(RequestError, match="the golden run is of 'best15', not of 'all'"):
        golden_run.compare(evidence, other, SETTINGS)


def test_few_shared_instances_say_nothing(evidence: Evidence) -> None:
    taken = golden_run.take(evidence)
    few = structs.replace(taken, errors=dict(list(taken.errors.items())[:5]))
    found = golden_run.compare(evidence, few, SETTINGS)
    assert found.outcome == "INCONCLUSIVE"
    assert "5 instances in 2 blocks are common to both runs, 20 in 4 are needed" in found.reason
    with pytest.raises(InconclusiveError, match="20 held-out instances"):
        golden_run.take(replace(evidence, iids=np.arange(5)))


@pytest.mark.parametrize(("left", "outcome"), [(195, "PASS"), (150, "INCONCLUSIVE")])
def test_what_is_gone_cannot_pass(evidence: Evidence, left: int, outcome: str) -> None:
    part = replace(evidence, iids=np.arange(left))
    found = golden_run.compare(part, golden_run.take(evidence), SETTINGS)
    assert (found.n, found.missing) == (left // 5, 40 - left // 5)
    assert found.outcome == outcome
    assert (outcome == "PASS") == (not found.reason)


def test_what_is_gone_hides_no_failure(evidence: Evidence) -> None:
    now = golden_run.take(evidence)
    before = structs.replace(now, errors={iid: error - 1 for iid, error in now.errors.items()})
    part = replace(evidence, iids=np.arange(150))
    assert golden_run.compare(part, before, SETTINGS).outcome == "FAIL"


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
def test_a_file_that_is_no_golden_run_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "g.json"
    path.write_text(content)
    with pytest.raises(RequestError, match=r"g\.json"):
        golden_run.read(path)

"""The verdict: one number and one outcome from measured axes."""

from __future__ import annotations

import json
from pathlib import Path
from statistics import NormalDist

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.gap_history.gate_status import outcome_of
from s2rstore.intervals import Interval
from s2rtools.gap.axis import Anchor, AxisResult, GapSettings, Measurement
from s2rtools.gap.gate import verdict
from s2rtools.gap.gate.verdict import judge

SETTINGS = GapSettings()


def axis_result(value: float, spread: float = 0.01, floor: float = 0.1) -> AxisResult:
    """An axis with a normal interval of standard error `spread`."""

    def bounds(level: float) -> Interval:
        half = NormalDist().inv_cdf(0.5 + level / 2) * spread
        return Interval(value - half, value, value + half, level)

    return AxisResult(value, floor, 50, bounds, {"features": "f", "n": 50})


BAD = Anchor(Interval(1.0, 1.1, 1.2), "bad")


def measurement_of(**axes: AxisResult) -> Measurement:
    return Measurement(axes, {}, {})


def scale(*axes: str, anchor: float = 1.1, floor: float = 0.1) -> verdict.Reference:
    frozen = {
        axis: verdict.AxisScale(anchor, anchor, anchor, floor, "bad",
                               {"features": "f", "n": 50})
        for axis in axes
    }  # fmt: skip
    return verdict.Reference(axes=frozen, made_from={}, source="ref.json", sha256="0" * 64)


def test_the_floor_is_0_and_the_anchor_100() -> None:
    at_floor = judge(measurement_of(task=axis_result(0.1)), scale("task"), SETTINGS)
    at_anchor = judge(measurement_of(task=axis_result(1.1)), scale("task"), SETTINGS)
    assert at_floor.gap.value == pytest.approx(0)
    assert at_anchor.gap.value == pytest.approx(100)
    assert (at_floor.outcome, at_anchor.outcome) == ("PASS", "FAIL")


def test_one_axis_above_the_threshold_fails_and_is_named() -> None:
    """The axis with the largest G has a wide interval and does not decide."""
    axes = {
        "task": axis_result(0.9, spread=0.6), "visual": axis_result(0.6), "c": axis_result(0.1)
    }  # fmt: skip
    verdict = judge(measurement_of(**axes), scale("task", "visual", "c"), SETTINGS)
    assert (verdict.outcome, verdict.worst) == ("FAIL", "task")
    assert verdict.reason.startswith("visual known to be above the threshold of 15")


def test_an_interval_across_the_threshold_is_inconclusive() -> None:
    verdict = judge(measurement_of(task=axis_result(0.25, spread=0.2)), scale("task"), SETTINGS)
    assert verdict.outcome == "INCONCLUSIVE"
    assert verdict.reason == "task not known to be below the threshold of 15"


def test_an_axis_above_the_threshold_at_another_level_is_said_to_be() -> None:
    """Its printed interval lies above the threshold, that of two axes at once does not."""
    near = axis_result(0.25 + 2.1 * 0.01, spread=0.01)
    verdict = judge(
        measurement_of(task=near, visual=axis_result(0.1)), scale("task", "visual"), SETTINGS
    )
    assert verdict.outcome == "INCONCLUSIVE"
    assert verdict.gap.low > 15
    assert verdict.reason == (
        "task not known to be below the threshold of 15; task above it at 95 %, not at 97.5 %, the "
        "level of a FAIL"
    )


def test_an_unjudged_axis_is_not_in_the_headline() -> None:
    verdict = judge(
        measurement_of(task=axis_result(0.1), visual=axis_result(9.0)), scale("task"), SETTINGS
    )
    assert (verdict.worst, verdict.outcome) == ("task", "PASS")
    assert "not judged by this reference: visual" in verdict.reason


def test_a_referenced_axis_without_evidence_is_rejected() -> None:
    measurement = Measurement({"task": axis_result(0.1)}, {"dynamics": "no drives"}, {})
    with pytest.raises(RequestError, match=r"ref\.json: judges dynamics.*no drives"):
        judge(measurement, scale("task", "dynamics"), SETTINGS)


@pytest.mark.parametrize(("value", "outcome"), [(0.1, "INCONCLUSIVE"), (1.1, "FAIL")])
def test_an_axis_with_too_little_evidence_cannot_pass(value: float, outcome: str) -> None:
    measurement = Measurement({"task": axis_result(value)}, {}, {"visual": "3 images, 50 needed"})
    verdict = judge(measurement, scale("task", "visual"), SETTINGS)
    assert verdict.outcome == outcome
    if outcome == "INCONCLUSIVE":
        assert "3 images" in verdict.reason


@pytest.mark.parametrize(
    ("change", "expected"),
    [({"features": "other"}, "features is f here and other"), ({"n": 10}, "n is 50 here and 10")],
)
def test_a_reference_with_another_fingerprint_is_rejected(change: dict, expected: str) -> None:
    base_scale = scale("task")
    fingerprint = {**base_scale.axes["task"].fingerprint, **change}
    frozen = msgspec.structs.replace(base_scale.axes["task"], fingerprint=fingerprint)
    with pytest.raises(RequestError, match=expected):
        judge(
            measurement_of(task=axis_result(0.1)),
            msgspec.structs.replace(base_scale, axes={"task": frozen}),
            SETTINGS,
        )


def test_an_anchor_within_the_noise_of_the_floor_cannot_be_frozen() -> None:
    noisy = axis_result(0.1, spread=0.5)
    anchor = Anchor(Interval(-0.7, 0.3, 1.3), "the constant prediction")
    with pytest.raises(RequestError, match=r"constant prediction.*within noise"):
        verdict.freeze_scale("task", noisy, anchor)


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", '{"format": 1, "axes": {}}', '{"format": 9, "axes": {"task": {}}}',
     '{"format": 1, "axes": {"task": 3}}', '{"format": 1, "axes": {"task": {"anchor": 1}}}',
     "\xff", pytest.param("[" * 100_000, id="deep")],
)  # fmt: skip
def test_an_invalid_reference_file_is_rejected(tmp_path: Path, content: str) -> None:
    path = tmp_path / "ref.json"
    path.write_bytes(content.encode("latin-1"))
    with pytest.raises(RequestError, match=r"ref\.json"):
        verdict.read_reference(path)


@pytest.mark.parametrize("change", [{"anchor": 1e-320}, {"floor": 1.1}, {"state": ["bad"]}])
def test_a_scale_without_span_or_state_is_rejected(tmp_path: Path, change: dict) -> None:
    frozen = {"anchor": 1.1, "anchor_low": 1.0, "anchor_high": 1.2, "floor": 0.0, "state": "bad",
              "fingerprint": {}}  # fmt: skip
    content = {"format": verdict.FORMAT, "made_from": {}, "axes": {"task": frozen | change}}
    (tmp_path / "ref.json").write_text(json.dumps(content))
    with pytest.raises(RequestError, match=r"ref\.json: axes\.task"):
        verdict.read_reference(tmp_path / "ref.json")


def test_non_numeric_scales_are_rejected(tmp_path: Path) -> None:
    low_noise = axis_result(0.1)
    frozen = verdict.freeze_scale("task", low_noise, BAD)
    path = tmp_path / "ref.json"
    text = verdict.reference_text({"task": frozen}, {})
    for key in ("anchor", "anchor_low", "anchor_high", "floor"):
        for value in (None, "1", True, float("inf"), 10**400, -1e308):
            content = json.loads(text)
            content["axes"]["task"][key] = value
            path.write_text(json.dumps(content))
            with pytest.raises(RequestError, match="task"):
                verdict.read_reference(path)


def test_a_file_with_an_anchor_within_noise_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "ref.json"
    frozen = msgspec.structs.replace(scale("task").axes["task"], anchor_low=0.05)
    path.write_text(verdict.reference_text({"task": frozen}, {}))
    with pytest.raises(RequestError, match="within noise of the floor"):
        verdict.read_reference(path)


@given(st.floats(-50, 200), st.floats(0, 50), st.floats(0, 50), st.floats(1, 100))
def test_the_outcome_follows_the_interval(
    value: float, below: float, above: float, threshold: float
) -> None:
    outcome = outcome_of(Interval(value - below, value, value + above), threshold)
    assert (outcome == "PASS") == (value + above < threshold)
    assert (outcome == "FAIL") == (value - below > threshold)

"""The visual axis on synthetic stores: floors, anchors, fingerprints and errors."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch

import s2rstore
from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.index import schema
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rtools.gap.axis import AxisResult, Evidence, GapSettings
from s2rtools.gap.report import plain
from s2rtools.gap.visual import visual_axis
from s2rtools.gap.visual.inception import FidInception
from s2rtools.gap.visual.visual_axis import MIN_DIFFERENCE, VisualAxis
from s2rtools.models.input_contract import InputContract
from s2rtui.cli import main
from tests.support import embeddings, tiny
from tests.support.copies import copy_store
from tests.support.networks import randomize_weights

N = 300
SETTINGS = GapSettings(seed=3)


def features_along_walk(seed: int, shift: float) -> np.ndarray:
    """Features at places of the rooms in any order; the places are the same for every seed."""
    x, y, heading = (part[np.random.default_rng(9).permutation(N)] for part in tiny.poses(N))
    positions = np.stack([x / 5, y / 4, np.cos(heading), np.sin(heading)], axis=1)
    mix = np.random.default_rng(8).normal(size=(4, 24)) / 2
    noise = np.random.default_rng(seed).normal(0, 0.1, (N, 24))
    return np.maximum(positions @ mix + shift, 0) + noise


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of one model: `far` with a gap, `near` with adapted images, `same` without any gap."""
    root = tiny.build(tmp_path_factory.mktemp("visual") / "s.s2r", N, ("far",), trained=("far",))
    real = features_along_walk(1, 0.0)
    add_run_like_far(root, "near", {"sim_adjustments": [{"name": "brightness", "value": 1.2}]})
    add_run_like_far(root, "same", {"model": "of-same"})
    embeddings.add(root, "far", {"sim": features_along_walk(2, 0.4), "real": real}, "embedding")
    embeddings.add(root, "near", {"sim": features_along_walk(2, 0.1), "real": real}, "embedding")
    embeddings.add(root, "same", {"sim": real, "real": real}, "embedding")
    return root


def add_run_like_far(root: Path, name: str, changes: dict[str, object]) -> None:
    """Add a run with the predictions of `far` and the given changes."""
    with edit(root) as draft:
        draft.insert_row(
            "model",
            {"model": f"of-{name}", "architecture": "resposenet", "sha256": "1" * 64,
             "input_height": 16, "input_width": 16, "convention": {}, "trained_by": None,
             "input": asdict(InputContract(size=(16, 16)))},
        )  # fmt: skip
        draft.insert_row(
            "run",
            {"run": name, "model": "far", "sim_domain": "sim", "real_domain": "real",
             "sim_adjustments": [], "real_adjustments": [], "key": "again",
             "precision": "float32", "created_at": "2026-02-01T00:00:00Z", **changes},
        )  # fmt: skip
        names = schema.BY_NAME["prediction"].column_names
        rows = draft.rows(f"SELECT {', '.join(names)} FROM prediction WHERE run = 'far'")
        columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
        draft.insert("prediction", columns | {"run": [name] * len(rows)})


@pytest.fixture(scope="module")
def store(path: Path) -> Iterator[Store]:
    with s2rstore.open(path) as opened:
        yield opened


def evidence(store: Store, run: str, iids: np.ndarray | None = None) -> Evidence:
    return Evidence(store, run, np.arange(N) if iids is None else iids)


@pytest.fixture(scope="module")
def measured(store: Store) -> Callable[[str], AxisResult]:
    """The axis of a run, measured once."""
    return cache(lambda run: VisualAxis().measure(evidence(store, run), SETTINGS))


@pytest.fixture
def far(measured: Callable[[str], AxisResult]) -> AxisResult:
    return measured("far")


def test_a_gap_exceeds_its_floor(far):
    assert far.floor == 0
    assert far.bounds(0.95).is_positive
    assert far.details["kid_p"] < 0.05
    halves = far.details["halves"]
    real = f"{halves['kid']['floor']:.3f} (range {halves['kid']['floor_low']:.3f} .."
    assert any(f"n = {halves['n']} each: KID" in note and real in note for note in far.notes)
    for name in ("fid", "kid", "sliced_wasserstein", "wasserstein", "kl_pca_sim_real"):
        assert halves[name]["value"] > halves[name]["floor"]
    for name in ("kl_poses_sim_real", "kl_poses_real_sim", "kl_errors_real_sim"):
        assert np.isfinite([halves[name]["value"], halves[name]["floor"]]).all()
    for name in ("kl_errors_sim_real", "kl_errors_real_sim"):
        assert halves[name]["value"] > halves[name]["floor_high"]
    assert halves["coverage"]["value"] < halves["coverage"]["floor"]
    json.dumps([far.details, dict(far.fingerprint)], allow_nan=False)


def test_every_dimension_is_reported_and_the_largest_are_printed(far):
    columns = far.details["halves"]["wasserstein_by_dimension"]
    assert columns["dimension"] == list(range(24))
    mean = far.details["halves"]["wasserstein"]
    assert np.mean(columns["value"]) == pytest.approx(mean["value"])
    assert np.mean(columns["floor"]) == pytest.approx(mean["floor"])
    printed = list(VisualAxis().describe(plain(far.details)))
    rows = printed[-1].strip().splitlines()[-3:]
    largest = np.argsort(columns["value"])[::-1][:3]
    assert [int(row.split()[0]) for row in rows] == largest.tolist()


def test_more_than_three_components_give_a_warning(store, far):
    assert not any("biased" in note for note in far.notes)
    with_five_components = VisualAxis(pca=5).measure(evidence(store, "far"), SETTINGS)
    assert any("5 dimensions is strongly biased" in note for note in with_five_components.notes)
    kl = "kl_pca_sim_real"
    assert with_five_components.details["halves"][kl] != far.details["halves"][kl]
    assert with_five_components.value == far.value


def test_only_held_out_instances_are_used(store, far):
    assert far.n == far.fingerprint["n"] == N // 5
    part = VisualAxis().measure(evidence(store, "far", np.arange(250)), SETTINGS)
    assert part.n == 50


def test_the_same_seed_gives_the_same_results(store, far):
    again = VisualAxis().measure(evidence(store, "far"), SETTINGS)
    assert far.bounds(0.95) == again.bounds(0.95)
    assert far.details == again.details
    other = VisualAxis().measure(evidence(store, "far"), GapSettings(seed=4))
    assert other.value == far.value
    assert other.details != far.details


def test_the_anchor_is_the_unadapted_state_of_the_same_model(store, measured, far):
    near = measured("near")
    assert far.fingerprint == near.fingerprint != measured("same").fingerprint
    anchor = VisualAxis().anchor(evidence(store, "near"), SETTINGS)
    assert anchor.interval.value == far.value > near.value > near.floor
    assert anchor.state == "the sim images before brightness=1.2 (run far)"


def test_the_anchor_of_adapted_real_images_is_the_unadapted_state(path, tmp_path):
    root = copy_store(path, tmp_path / "s.s2r")
    add_run_like_far(root, "dark", {"real_adjustments": [{"name": "brightness", "value": 0.8}]})
    with s2rstore.open(root) as store:
        far = VisualAxis().measure(evidence(store, "far"), SETTINGS)
        anchor = VisualAxis().anchor(evidence(store, "dark"), SETTINGS)
    assert anchor.interval.value == far.value
    assert anchor.state == "the real images before brightness=0.8 (run far)"


def test_unadapted_images_are_no_bad_state_of_themselves(path, tmp_path):
    """G would be 100 whatever the images are: the bad state has to be declared."""
    frozen = tmp_path / "ref.json"
    command = ["gap", str(path), "--axis", "visual", "--run"]
    assert main([*command, "far", "--freeze", str(frozen)]) == 2
    assert not frozen.exists()
    assert main([*command, "far", "--freeze", str(frozen), "--anchor-run", "far"]) == 0
    with s2rstore.open(path) as store, pytest.raises(RequestError, match="--anchor-run"):
        VisualAxis().anchor(evidence(store, "far"), SETTINGS)


def test_without_an_unadapted_run_there_is_no_anchor(path, tmp_path):
    root = copy_store(path, tmp_path / "s.s2r")
    with edit(root) as draft:
        draft.delete("run", run="far")
    with s2rstore.open(root) as store:
        assert VisualAxis().measure(evidence(store, "near"), SETTINGS).value > 0
        with pytest.raises(RequestError, match="add a run of model 'far'"):
            VisualAxis().anchor(evidence(store, "near"), SETTINGS)


def test_too_few_images_are_inconclusive_for_the_visual_axis(store):
    for iids in (np.array([4, 9, 14]), np.arange(0), np.arange(5 * MIN_DIFFERENCE - 5)):
        with pytest.raises(InconclusiveError, match=f"at least {MIN_DIFFERENCE}"):
            VisualAxis().measure(evidence(store, "far", iids), SETTINGS)
    with pytest.raises(RequestError, match="iids 0"):
        VisualAxis().measure(evidence(store, "far", np.array([N])), SETTINGS)


def test_large_selections_are_sampled_by_blocks(store, monkeypatch):
    monkeypatch.setattr(visual_axis, "MAX_INSTANCES", 49)
    result = VisualAxis().measure(evidence(store, "far"), SETTINGS)
    assert 36 <= result.n == result.fingerprint["n"] <= 49
    assert result.notes[0] == f"{result.n} of 60 instances, a random sample of whole blocks"
    assert VisualAxis().measure(evidence(store, "far"), SETTINGS).value == result.value


def test_non_finite_features_are_rejected(path, tmp_path):
    root = copy_store(path, tmp_path / "s.s2r")
    add_run_like_far(root, "run", {})
    sim = features_along_walk(2, 0.1)
    sim[[4, 9, 14], 3] = np.nan
    embeddings.add(root, "run", {"sim": sim, "real": features_along_walk(1, 0.0)}, "embedding")
    with s2rstore.open(root) as store:
        message = r"sim features of instances 4, 9, 14 .* - ids\(4, 9, 14\)"
        with pytest.raises(RequestError, match=message):
            VisualAxis().measure(evidence(store, "run"), SETTINGS)
        rest = np.setdiff1d(np.arange(N), [4, 9, 14])
        assert VisualAxis().measure(evidence(store, "run", rest), SETTINGS).n == N // 5 - 3


def test_missing_embeddings_are_explained(tiny_store, store):
    assert VisualAxis().missing(evidence(store, "far")) is None
    with s2rstore.open(tiny_store) as without_embeddings:
        reason = VisualAxis().missing(Evidence(without_embeddings, "vanilla", np.arange(40)))
        assert reason is not None
        assert "no embeddings" in reason
        with pytest.raises(RequestError, match="run 'nobody'"):
            VisualAxis().missing(Evidence(without_embeddings, "nobody", np.arange(40)))


def test_a_declared_network_computes_the_features(store, tmp_path):
    torch.save(randomize_weights(FidInception()).state_dict(), tmp_path / "w.pth")
    file = tmp_path / "network.toml"
    file.write_text(
        'architecture = "inception_v3_fid"\nweights = "w.pth"\n'
        '[preprocessing]\nsize = [75, 75]\nfilter = "bilinear"\nrange = [-1.0, 1.0]\n'
    )
    iids = np.arange(MIN_DIFFERENCE)
    evidence_of_near = Evidence(store, "near", iids, features=file)
    result = VisualAxis().measure(evidence_of_near, SETTINGS)
    # Training images of the pose model are valid for another network.
    assert result.n == MIN_DIFFERENCE
    assert result.fingerprint["features"] == "inception_v3_fid:pool3"
    assert result.fingerprint["dimensions"] == 2048
    anchor = VisualAxis().anchor(evidence_of_near, SETTINGS)
    assert anchor.interval.value != result.value  # `near` brightens the images of `far`
    (tmp_path / "w.pth").unlink()
    with pytest.raises(RequestError, match=r"w\.pth: cannot be read"):
        VisualAxis().measure(evidence_of_near, SETTINGS)

"""The visual axis on synthetic stores: floors, anchors, fingerprints, refusals."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import s2rstore
from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.index import schema
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rtools.gap.axis_result import Evidence, GapSettings
from s2rtools.gap.gate import gate
from s2rtools.gap.report import plain
from s2rtools.gap.visual import visual_axis
from s2rtools.gap.visual.inception import FidInception
from s2rtools.gap.visual.visual_axis import MIN_INSTANCES, VisualAxis
from s2rtui.cli.formatting.gap_details import details
from tests.support import embeddings, tiny
from tests.support.copies import copy_store
from tests.support.networks import randomize_weights

N = 250
SETTINGS = GapSettings(replicates=200, seed=3)
_PREDICTED = ("kl_poses", "kl_error")


def look(seed: int, shift: float) -> np.ndarray:
    """Features of a walk through the rooms, the same walk for every seed."""
    x, y, heading = tiny.poses(N)
    places = np.stack([x / 5, y / 4, np.cos(heading), np.sin(heading)], axis=1)
    mix = np.random.default_rng(8).normal(size=(4, 24)) / 2
    noise = np.random.default_rng(seed).normal(0, 0.1, (N, 24))
    return np.maximum(places @ mix + shift, 0) + noise


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of one model: `far` with a gap, `near` with adapted images, `same` without any gap."""
    root = tiny.build(tmp_path_factory.mktemp("visual") / "s.s2r", N, ("far",))
    real = look(1, 0.0)
    again(root, "near", {"sim_adjustments": [{"name": "brightness", "value": 1.2}]})
    again(root, "same", {"model": "of-same"})
    embeddings.add(root, "far", {"sim": look(2, 0.4), "real": real}, "embedding")
    embeddings.add(root, "near", {"sim": look(2, 0.1), "real": real}, "embedding")
    embeddings.add(root, "same", {"sim": real, "real": real}, "embedding")
    return root


def again(root: Path, name: str, other: dict[str, object]) -> None:
    """Another run with the predictions of `far`, and what is other about it."""
    with edit(root) as draft:
        draft.insert_row(
            "model",
            {"model": f"of-{name}", "architecture": "resposenet", "sha256": "1" * 64,
             "input_height": 16, "input_width": 16, "convention": {}, "trained_by": None},
        )  # fmt: skip
        draft.insert_row(
            "run",
            {"run": name, "model": "far", "sim_domain": "sim", "real_domain": "real",
             "sim_adjustments": [], "real_adjustments": [], "key": "again",
             "precision": "float32", "created_at": "2026-02-01T00:00:00Z", **other},
        )  # fmt: skip
        names = schema.BY_NAME["prediction"].column_names
        rows = draft.rows(f"SELECT {', '.join(names)} FROM prediction WHERE run = 'far'")
        columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
        draft.insert("prediction", columns | {"run": [name] * len(rows)})


@pytest.fixture
def store(path: Path) -> Iterator[Store]:
    with s2rstore.open(path) as opened:
        yield opened


def evidence(store: Store, run: str, iids: np.ndarray | None = None) -> Evidence:
    return Evidence(store, run, np.arange(N) if iids is None else iids)


def test_a_gap_is_seen_beside_its_floor(store: Store) -> None:
    far = VisualAxis().measure(evidence(store, "far"), SETTINGS)
    assert far.floor == 0
    assert not far.floor_replicates.any()
    assert np.percentile(far.replicates, 2.5) > 0
    assert far.replicates.shape == far.floor_replicates.shape == (200,)
    assert far.details["kid_p"] < 0.05
    halves = far.details["halves"]
    real = f"{halves['kid']['floor']:.3f} ({halves['kid']['floor_low']:.3f} .."
    assert any(f"n = {halves['n']} each: KID" in note and real in note for note in far.notes)
    for name in ("fid", "kid", "sliced_wasserstein", "wasserstein", "kl_pca_sim_real"):
        assert halves[name]["value"] > halves[name]["floor"]
    for name in ("kl_poses_sim_real", "kl_poses_real_sim", "kl_errors_real_sim"):
        assert np.isfinite([halves[name]["value"], halves[name]["floor"]]).all()
    assert halves["coverage"]["value"] < halves["coverage"]["floor"]
    json.dumps([far.details, dict(far.fingerprint)], allow_nan=False)


def test_errors_that_differ_are_told_by_their_divergence(store: Store) -> None:
    halves = VisualAxis().measure(evidence(store, "far"), SETTINGS).details["halves"]
    assert halves["kl_errors_sim_real"]["value"] > halves["kl_errors_sim_real"]["floor_high"]
    assert halves["kl_errors_real_sim"]["value"] > halves["kl_errors_real_sim"]["floor_high"]


def test_every_dimension_is_told_and_the_largest_are_printed(store: Store) -> None:
    found = VisualAxis().measure(evidence(store, "far"), SETTINGS)
    columns = found.details["halves"]["wasserstein_by_dimension"]
    assert columns["dimension"] == list(range(24))
    mean = found.details["halves"]["wasserstein"]
    assert np.mean(columns["value"]) == pytest.approx(mean["value"])
    assert np.mean(columns["floor"]) == pytest.approx(mean["floor"])
    printed = list(details({"axis": "visual", "details": plain(found.details)}))
    rows = printed[-1].strip().splitlines()[-3:]
    largest = np.argsort(columns["value"])[::-1][:3]
    assert [int(row.split()[0]) for row in rows] == largest.tolist()


def test_more_components_than_three_are_warned_of(store: Store) -> None:
    calm = VisualAxis().measure(evidence(store, "far"), SETTINGS)
    assert not any("biased" in note for note in calm.notes)
    bold = VisualAxis().measure(evidence(store, "far"), replace(SETTINGS, pca=5))
    assert any("5 dimensions is strongly biased" in note for note in bold.notes)
    kl = "kl_pca_sim_real"
    assert bold.details["halves"][kl] != calm.details["halves"][kl]
    assert bold.value == calm.value


def test_only_what_the_model_was_not_trained_on_counts(store: Store) -> None:
    far = VisualAxis().measure(evidence(store, "far"), SETTINGS)
    assert far.n == far.fingerprint["n"] == N // 5
    part = VisualAxis().measure(evidence(store, "far", np.arange(220)), SETTINGS)
    assert part.n == 44


def test_identical_images_are_at_the_floor_to_the_bit(store: Store) -> None:
    same = VisualAxis().measure(evidence(store, "same"), SETTINGS)
    assert same.value == same.floor
    assert np.array_equal(same.replicates, same.floor_replicates)
    assert same.details["kid_p"] == 1.0
    halves = same.details["halves"]
    seen = {k: f for k, f in halves.items() if isinstance(f, dict) and k[:8] not in _PREDICTED}
    assert len(seen) == 11
    assert all(f["value"] == f["floor"] for f in seen.values())


def test_the_same_seed_gives_the_same_figures(store: Store) -> None:
    once, again = (VisualAxis().measure(evidence(store, "far"), SETTINGS) for _ in range(2))
    assert np.array_equal(once.replicates, again.replicates)
    assert once.details == again.details
    other = VisualAxis().measure(evidence(store, "far"), GapSettings(200, seed=4))
    assert other.value == once.value
    assert not np.array_equal(other.replicates, once.replicates)


def test_the_anchor_is_the_unadapted_state(store: Store) -> None:
    near, far = (VisualAxis().measure(evidence(store, run), SETTINGS) for run in ("near", "far"))
    anchor = VisualAxis().anchor(evidence(store, "near"), SETTINGS)
    assert anchor.value == far.value > near.value > near.floor
    assert anchor.state == "the sim images before brightness=1.2 (run far)"
    own = VisualAxis().anchor(evidence(store, "far"), SETTINGS)
    assert own.value == far.value
    assert np.array_equal(own.replicates, far.replicates)
    assert "unadapted" in own.state


def test_without_an_unadapted_run_there_is_no_anchor(path: Path, tmp_path: Path) -> None:
    root = copy_store(path, tmp_path / "s.s2r")
    with edit(root) as draft:
        draft.delete("run", run="far")
    with s2rstore.open(root) as store:
        assert VisualAxis().measure(evidence(store, "near"), SETTINGS).value > 0
        with pytest.raises(RequestError, match="add a run of model 'far'"):
            VisualAxis().anchor(evidence(store, "near"), SETTINGS)


def test_other_models_have_other_fingerprints(store: Store) -> None:
    far, near, same = (
        VisualAxis().measure(evidence(store, run), SETTINGS).fingerprint
        for run in ("far", "near", "same")
    )
    assert far == near
    assert far != same


def test_too_few_images_are_inconclusive(store: Store) -> None:
    for iids in (np.array([4, 9, 14]), np.arange(0), np.arange(5 * MIN_INSTANCES - 5)):
        with pytest.raises(InconclusiveError, match=f"at least {MIN_INSTANCES}"):
            VisualAxis().measure(evidence(store, "far", iids), SETTINGS)
    with pytest.raises(RequestError, match="iids 0"):
        VisualAxis().measure(evidence(store, "far", np.array([N])), SETTINGS)


def test_more_images_than_needed_are_sampled_by_blocks(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(visual_axis, "MAX_INSTANCES", 44)
    found = VisualAxis().measure(evidence(store, "far"), SETTINGS)
    assert 36 <= found.n == found.fingerprint["n"] <= 44
    assert any("bootstrap over" in note for note in found.notes)
    assert found.notes[0] == f"{found.n} of 50 instances, a random sample of whole blocks"
    assert VisualAxis().measure(evidence(store, "far"), SETTINGS).value == found.value


def test_rows_that_are_not_finite_are_refused(path: Path, tmp_path: Path) -> None:
    root = copy_store(path, tmp_path / "s.s2r")
    again(root, "run", {})
    sim = look(2, 0.1)
    sim[[4, 9, 14], 3] = np.nan
    embeddings.add(root, "run", {"sim": sim, "real": look(1, 0.0)}, "embedding")
    with s2rstore.open(root) as store:
        with pytest.raises(
            RequestError, match=r"sim features of instances 4, 9, 14 .* - ids\(4, 9, 14\)"
        ):
            VisualAxis().measure(evidence(store, "run"), SETTINGS)
        rest = np.setdiff1d(np.arange(N), [4, 9, 14])
        assert VisualAxis().measure(evidence(store, "run", rest), SETTINGS).n == N // 5 - 3


def test_what_is_missing_is_said(tiny_store: Path, store: Store) -> None:
    assert VisualAxis().missing(evidence(store, "far")) is None
    with s2rstore.open(tiny_store) as bare:
        told = VisualAxis().missing(Evidence(bare, "vanilla", np.arange(40)))
        assert told is not None
        assert "no embeddings" in told
        asked = gate.GapRequest(axes=("visual",))
        with pytest.raises(RequestError, match=r"--axis visual: cannot be measured: .*no embed"):
            gate.judge_gap(Evidence(bare, "vanilla", np.arange(40)), asked)
        with pytest.raises(RequestError, match="run 'nobody'"):
            VisualAxis().missing(Evidence(bare, "nobody", np.arange(40)))


def test_images_are_looked_at_by_a_declared_network(store: Store, tmp_path: Path) -> None:
    torch.save(randomize_weights(FidInception()).state_dict(), tmp_path / "w.pth")
    file = tmp_path / "network.toml"
    file.write_text(
        'architecture = "inception_v3_fid"\nweights = "w.pth"\n'
        '[preprocessing]\nsize = [75, 75]\nfilter = "bilinear"\nrange = [-1.0, 1.0]\n'
    )
    iids = np.arange(0, 60)
    asked = Evidence(store, "near", iids, features=file)
    found = VisualAxis().measure(asked, SETTINGS)
    assert found.n == 60  # images that a pose model was trained on count for another network
    assert found.fingerprint["features"] == "inception_v3_fid:pool3"
    assert found.fingerprint["dimensions"] == 2048
    anchor = VisualAxis().anchor(asked, SETTINGS)
    assert anchor.value != found.value  # `near` brightens what `far` leaves as it is
    (tmp_path / "w.pth").unlink()
    with pytest.raises(RequestError, match=r"w\.pth: cannot be read"):
        VisualAxis().measure(asked, SETTINGS)

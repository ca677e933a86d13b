"""The adjustment by a translator: chains, strength, registration and refusals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify
from s2rstore.run_inputs import chain_text
from s2rtools.adjustments import apply_chain, make_chain, parse_adjustment
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.input_hashes import InputHashes
from s2rtools.precompute.run_registration import add_run
from s2rtools.translation import fit_split
from s2rtools.translation.translator_file import load_translator
from s2rtools.translator_evaluation.fit_into_store import FitRequest, fit_into_store, stored_split
from s2rtui.session import adjusting
from s2rtui.session.session import Session
from tests.conftest import BuildOnce
from tests.support.copies import copy_store


@pytest.fixture
def fitted(tiny_store: Path, build_once: BuildOnce, tmp_path: Path) -> Path:
    """A store with the translator `to_sim` of its real images."""
    return copy_store(
        build_once("translator.s2r", lambda path: _fit(tiny_store, path)), tmp_path / "own.s2r"
    )


def _fit(tiny_store: Path, path: Path) -> None:
    request = FitRequest("mkl", "to_sim", "real2sim", depth_noise=True)
    fit_into_store(copy_store(tiny_store, path), request, "s2r translate fit mkl")


def chain_of(root: Path, text: str):
    with s2rstore.open(root) as store:
        steps = parse_adjustment(text)["real"]
        return make_chain("real", {s["name"]: s["value"] for s in steps}, store.translators)


def images_of(root: Path):
    with s2rstore.open(root) as store:
        frames = store.frames("real", 0, 4)
        domain = store.domain("real")
    depth = frames["depth"]
    return frames["rgb"], depth, (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)


def test_a_fitted_translator_is_listed_and_verified(fitted):
    with s2rstore.open(fitted) as store:
        record = store.translator("to_sim")
        assert (record.method, record.side, record.source_domain) == ("mkl", "real", "real")
        codes = stored_split(store, "to_sim")
        held_out = np.flatnonzero(codes == fit_split.HELD_OUT)
        # A verdict needs eight held-out images.
        assert record.accepted is (True if len(held_out) >= 8 else None)
        assert (codes == fit_split.FITTED).any()
    assert not verify(fitted)


def test_the_strength_blends_and_0_returns_the_same_arrays(fitted):
    images, chain = images_of(fitted), chain_of(fitted, "real:translate=to_sim")
    full, _ = apply_chain(*images, chain, fitted)
    half, _ = apply_chain(*images, chain_of(fitted, "real:translate=to_sim@0.5"), fitted)
    assert (full != images[0]).any()
    assert np.abs(half - (images[0].astype(float) + full) / 2).max() <= 0.51
    rgb, depth = apply_chain(*images, [{**chain[0], "value": 0.0}], fitted)
    assert rgb is images[0]
    assert depth is images[1]


def test_images_of_a_batch_are_translated_independently(fitted):
    images = images_of(fitted)
    chain = chain_of(fitted, "real:translate=to_sim")
    rgb, depth = apply_chain(*images, chain, fitted)
    for index in range(len(rgb)):
        one = apply_chain(*(image[index : index + 1] for image in images), chain, fitted)
        assert (one[0][0] == rgb[index]).all()
        assert (one[1][0] == depth[index]).all()


def test_chains_read_as_the_command_line_takes_them(fitted):
    text = "translate=to_sim@0.5, brightness=1.1"
    assert chain_text(chain_of(fitted, f"real:{text}")) == text
    assert chain_text(chain_of(fitted, "real:translate=to_sim")) == "translate=to_sim"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("real:translate", "needs a translator"),
        ("real:translate=to_sim@2", r"0 \.\. 1"),
        ("real:translate=to_sim@much", "not a number"),
    ],
)
def test_wrong_requests_name_what_is_allowed(text, message):
    with pytest.raises(RequestError, match=message):
        parse_adjustment(text)


def test_unknown_translators_name_the_known_ones(fitted):
    with pytest.raises(RequestError, match="translators: to_sim"):
        chain_of(fitted, "real:translate=to_moon")


def test_a_run_uses_a_translator_of_its_side_alone(fitted):
    model = "vanilla"
    chains = parse_adjustment("sim:translate=to_sim")
    with pytest.raises(RequestError, match="translates images of domain real"):
        add_run(fitted, "wrong", model, None, None, chains)
    add_run(fitted, "right", model, None, None, parse_adjustment("real:translate=to_sim"))
    with s2rstore.open(fitted) as store:
        assert (
            store.runs["right"].real_adjustments[0]["sha256"] == store.translator("to_sim").sha256
        )


def test_a_refused_translator_needs_force(fitted):
    with edit(fitted) as draft:
        draft.update(
            "translator", {"translator": "to_sim"}, {"accepted": False, "reasons": '["blurs"]'}
        )
    chains = parse_adjustment("real:translate=to_sim")
    with pytest.raises(RequestError, match=r"refused \(blurs\); add --force"):
        add_run(fitted, "blurred", "vanilla", None, None, chains)
    assert add_run(fitted, "blurred", "vanilla", None, None, chains, force=True) == "blurred"
    session = Session(fitted)
    sliders, _ = adjusting.available_sliders(session.store)
    assert "translate:to_sim" not in [slider.name for slider in sliders]
    session.close()


def test_the_name_of_a_translator_changes_no_array_key(fitted):
    with s2rstore.open(fitted) as store:
        run = store.run("vanilla")
        chains = [chain_of(fitted, "real:translate=to_sim")]
        chains.append([{**chains[0][0], "name": "translate:renamed"}])
        hashes, iids = InputHashes(store), store.parts[0].iids
        runs = [replace(run, real_adjustments=chain) for chain in chains]
        keys = [ArrayKeys(hashes, each, iids).prediction({}, []) for each in runs]
    assert keys[0] == keys[1]


def test_the_panel_has_a_slider_per_translator(fitted):
    session = Session(fitted)
    session.dispatch(adjusting.open_sliders, *adjusting.available_sliders(session.store))
    adjust = session.state.adjust
    index = [slider.name for slider in adjust.sliders].index("translate:to_sim")
    state = session.dispatch(adjusting.set_slider, index, 0.5)
    chains = adjusting.adjustment_chains(session.store, state.adjust)
    assert chains["real"] == chain_of(fitted, "real:translate=to_sim@0.5")
    session.close()


def test_a_missing_translator_file_is_named(fitted):
    chain = chain_of(fitted, "real:translate=to_sim")
    file = fitted / "translators" / f"{chain[0]['sha256']}.safetensors"
    images = images_of(fitted)
    content = file.read_bytes()
    file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(RequestError, match="checksum"):
        apply_chain(*images, chain, fitted)
    file.unlink()
    with pytest.raises(RequestError, match=file.name):
        apply_chain(*images, chain, fitted)
    assert any(file.name in damage.where for damage in verify(fitted))


def test_pruning_keeps_the_translators_in_use(fitted):
    unused = fitted / "translators" / ("0" * 64 + ".safetensors")
    unused.write_bytes(b"")
    prune(fitted)
    assert not unused.exists()
    assert load_translator("to_sim", fitted).method == "mkl"


def test_names_are_used_once(fitted):
    with pytest.raises(RequestError, match="already in"):
        fit_into_store(fitted, FitRequest("mkl", "to_sim", "real2sim"), "")

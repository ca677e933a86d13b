"""Training images outside of memory, and the recipe that trains on translated images."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rtools.models.input_contract import InputContract
from s2rtools.models.preprocessing import preprocess
from s2rtools.precompute.prediction_rows import decode_split
from s2rtools.training.splits import NO_SPLIT, TRAIN, UNSEEN, split_by_blocks
from s2rtools.training.train_into_store import TrainingRequest, train_into_store
from s2rtools.training.training_frames import CopiedFrames, DiskArray, StreamedFrames
from s2rtools.translator_evaluation.fit_into_store import FitRequest, fit_into_store
from tests.support.copies import copy_store
from tests.support.one_side import append_side

N, CONTRACT = 70, InputContract(size=(24, 24))


@pytest.fixture(scope="module")
def images() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 256, (N, 128, 128, 3), dtype=np.uint8)
    return rgb, rng.integers(0, 9000, (N, 128, 128), dtype=np.uint16)


def blocks(images: tuple[np.ndarray, np.ndarray], rows: int = 16):
    rgb, depth = images
    return ((rgb[k : k + rows], depth[k : k + rows]) for k in range(0, N, rows))


@pytest.mark.parametrize("rows", [[5], [69, 0, 33, 33], list(range(20, 50)), []])
def test_copied_and_streamed_frames_are_those_in_memory(images, rows, tmp_path):
    rgb, depth = images
    copied = CopiedFrames.from_blocks("sim", blocks(images), N, CONTRACT, 0.001, tmp_path)
    streamed = StreamedFrames("sim", lambda a, b: [(rgb[a:b], depth[a:b])], CONTRACT, 0.001)
    expected = preprocess(rgb[rows], depth[rows], 0.001, CONTRACT)
    chosen = np.array(rows, dtype=np.intp)
    assert np.array_equal(copied.inputs(chosen), expected)
    assert np.array_equal(streamed.inputs(chosen), expected)
    assert not list(tmp_path.iterdir())  # the copies have no names
    assert copied.depth.dtype == np.uint16
    with pytest.raises(ValueError, match=f"expected {N + 1}"):
        CopiedFrames.from_blocks("sim", blocks(images), N + 1, CONTRACT, 0.001, tmp_path)


def test_a_full_disk_is_an_error_that_names_the_folder(tmp_path):
    array = DiskArray((4,), np.dtype(np.uint8), tmp_path)

    class Full:
        def write(self, content: object) -> None:
            raise OSError(28, "No space left on device")

    array._file = Full()
    with pytest.raises(RequestError, match=rf"{tmp_path}: .*No space left"):
        array.append(np.zeros((2, 4), dtype=np.uint8))
    with pytest.raises(IndexError):
        array[np.array([0])]


def test_images_without_a_partner_are_trained_on_and_missing_ones_belong_to_no_split(store_copy):
    append_side(store_copy, "sim", 24, "renders")
    append_side(store_copy, "real", 8, "photos")
    with Store(store_copy) as store:
        count = len(store.instances)
        renders, photos = store.iids_of("renders"), store.iids_of("photos")
        pairs = store.instances.trajectory[store.imaged("sim", "real")]
    train_into_store(store_copy, TrainingRequest("vanilla", name="v", steps=3), print, "s2r train")
    with Store(store_copy) as store:
        facts = store.provenance("model:v")
    sim, real = (decode_split(facts[f"split:{side}"], count) for side in ("sim", "real"))
    assert sim[: pairs.size].tolist() == split_by_blocks(pairs).tolist()
    assert (sim[renders] == TRAIN).any()
    assert (sim[photos] == NO_SPLIT).all()
    assert (real[renders] == NO_SPLIT).all()
    assert (real[photos] == UNSEEN).all()
    alone = TrainingRequest("vanilla", name="w", steps=3, expression="has:sim - paired")
    train_into_store(store_copy, alone, print, "s2r train")
    with Store(store_copy) as store:
        learned = decode_split(store.provenance("model:w")["split:sim"], count)
    assert (learned[: pairs.size] == UNSEEN).all()
    assert learned[renders].tolist() == sim[renders].tolist()
    nothing = replace(alone, name="n", expression="has:real & has:sim - paired")
    with pytest.raises(RequestError, match="selects no instance"):
        train_into_store(store_copy, nothing, print, "s2r train")


def train_translated(root: Path, **settings: object) -> str:
    request = TrainingRequest(**{"recipe": "translated", "steps": 2, **settings})
    return train_into_store(root, request, lambda *_: None, "s2r train_translated")


def test_the_run_shows_the_images_that_the_model_was_trained_on(store_copy):
    for method, name, run in (("mkl", "to_real", "shifted"), ("identity", "same", "plain")):
        fit_into_store(store_copy, FitRequest(method, name), "")
        assert train_translated(store_copy, translator=name, name=run, force=True) == run
    with s2rstore.open(store_copy) as store:
        steps = store.runs["shifted"].sim_adjustments
        assert [step["name"] for step in steps] == ["translate:to_real"]
        weights = {name: store.models[name].sha256 for name in ("shifted", "plain")}
    assert weights["shifted"] != weights["plain"]


def test_stores_with_other_translators_do_not_resume_each_others_training(
    tiny_store, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    request = TrainingRequest("translated", translator="to_real", steps=2)
    done: list[float] = []

    def interrupted(fraction: float, *_: float) -> None:
        done.append(fraction)
        raise KeyboardInterrupt

    for method in ("mkl", "reinhard"):
        root = copy_store(tiny_store, tmp_path / f"{method}.s2r")
        fit_into_store(root, FitRequest(method, "to_real"), "")
        with pytest.raises(KeyboardInterrupt):
            train_into_store(root, request, interrupted, "s2r train_translated")
    assert done == [0.5, 0.5]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "name a --translator"),
        ({"translator": "nothing"}, "translators: none"),
        ({"recipe": "vanilla", "translator": "to_real"}, "not with --recipe vanilla"),
    ],
)
def test_wrong_requests_say_what_is_needed(store_copy, settings, message):
    with pytest.raises(RequestError, match=message):
        train_translated(store_copy, **{"name": "new", **settings})

"""The recipe that trains on translated sim images."""

from __future__ import annotations

from pathlib import Path

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.training.train_into_store import TrainingRequest, train_into_store
from s2rtools.translator_evaluation.fit_into_store import FitRequest, fit_into_store
from tests.support.copies import copy_store


def train(root: Path, **settings: object) -> str:
    request = TrainingRequest(**{"recipe": "translated", "steps": 2, **settings})
    return train_into_store(root, request, lambda *_: None, "s2r train")


def test_the_run_shows_the_images_that_the_model_was_trained_on(store_copy: Path):
    for method, name, run in (("mkl", "to_real", "shifted"), ("identity", "same", "plain")):
        fit_into_store(store_copy, FitRequest(method, name), "")
        assert train(store_copy, translator=name, name=run, force=True) == run
    with s2rstore.open(store_copy) as store:
        steps = store.runs["shifted"].sim_adjustments
        assert [step["name"] for step in steps] == ["translate:to_real"]
        weights = {name: store.models[name].sha256 for name in ("shifted", "plain")}
    assert weights["shifted"] != weights["plain"]


def test_stores_with_other_translators_do_not_resume_each_others_training(
    tiny_store: Path, tmp_path: Path, monkeypatch
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
            train_into_store(root, request, interrupted, "s2r train")
    assert done == [0.5, 0.5]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "name a --translator"),
        ({"translator": "nothing"}, "translators: none"),
        ({"recipe": "vanilla", "translator": "to_real"}, "not with --recipe vanilla"),
    ],
)
def test_wrong_requests_say_what_is_needed(store_copy: Path, settings, message):
    with pytest.raises(RequestError, match=message):
        train(store_copy, **{"name": "new", **settings})

"""`s2r translate`: fit, list and wrong requests."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from s2rtools.translation.translator_file import read_translator
from s2rtui.cli import main


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Two folders of images; the second has a colour cast."""
    rng = np.random.default_rng(0)
    paths = tmp_path / "camera", tmp_path / "simulation"
    for path, cast in zip(paths, ([1, 1, 1], [0.5, 0.8, 1]), strict=True):
        path.mkdir()
        for number in range(4):
            blobs = rng.uniform(20, 230, (4, 6, 3)).repeat(8, axis=0).repeat(8, axis=1)
            cv2.imwrite(str(path / f"{number}.png"), (blobs * cast).astype(np.uint8))
    return paths


def test_a_translator_of_a_store_is_fitted_and_listed(store_copy, s2r):
    fit = ["translate", "fit", "reinhard", "--direction", "real2sim", "--store", str(store_copy)]
    assert "translator reinhard-real2sim registered" in s2r(*fit).printed
    (row,) = s2r("translate", "list", "--store", store_copy, "--json").json
    assert (row["translator"], row["from"], row["to"]) == ("reinhard-real2sim", "real", "sim")


def test_the_same_seed_gives_the_same_file(folders, tmp_path):
    camera, simulation = (str(path) for path in folders)
    files = [tmp_path / "a.safetensors", tmp_path / "b.safetensors"]
    for file in files:
        fit = ["translate", "fit", "mkl", "--source", camera, "--target", simulation]
        assert main([*fit, "--out", str(file), "--option", "statistics=image"]) == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    assert read_translator(files[0]).source == "camera"


WRONG_REQUESTS = (
    ("fit vangogh --store STORE", "vangogh"),
    ("fit mkl", "name --store S, or --source"),
    ("fit mkl --source a --out b", "--target"),
    ("fit mkl --store STORE --domains sim", "SIM,REAL"),
    ("fit mkl --store STORE --domains sim,sim", "two different domains"),
    ("fit mkl --store STORE --domains real,sim", "real is a real domain"),
    ("fit mkl --store STORE --paired", "mkl does not use pairs"),
    ("fit mkl --store STORE --option beta=1", "mkl: option 'beta': one of statistics"),
    ("fit mkl --store STORE --size 3", "--size"),
    ("fit mkl --store STORE --name ../x", "../x"),
    ("fit all --store STORE --name x", "--name"),
    ("fit mkl --source /nowhere --target /nowhere --out x.safetensors", "/nowhere"),
    ("apply nothing in out", "--store"),
    ("apply missing.safetensors in out", "missing.safetensors"),
    ("apply missing.safetensors in out --strength 2", "--strength"),
)


def test_wrong_requests_end_in_one_line(tiny_store, tmp_path, monkeypatch, s2r):
    monkeypatch.chdir(tmp_path)
    for request_text, message in WRONG_REQUESTS:
        words = request_text.replace("STORE", str(tiny_store)).split()
        s2r("translate", *words).assert_refused(message)
    assert not list(tmp_path.glob("*.safetensors"))

"""Models behind a translator, and the agreement of segmentations."""

import json

import cv2
import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rtools.translation.colour_maps import IdentityTranslator
from s2rtools.translator_evaluation.downstream import (
    judge_downstream,
    load_downstream,
    read_truth,
    segmentation_agreement,
)
from s2rtui.cli import main


class Halved(IdentityTranslator):
    def apply(self, rgb):
        return rgb // 2


class Bright:
    """Labels pixels above a grey level; scored by mean intersection over union."""

    def predict(self, image):
        return (image.mean(axis=2) > 100).astype(np.uint8)

    def score(self, result, truth):
        return segmentation_agreement(result, truth).mean_iou


def scenes(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Dark images with a bright right part, too bright by a factor of two, and their labels."""
    rng = np.random.default_rng(0)
    labels = np.zeros((count, 16, 16), dtype=np.uint8)
    for row, label in enumerate(labels):
        label[:, 4 + row % 8 :] = 1
    levels = np.where(labels, 220, 120) + rng.integers(-9, 10, labels.shape)
    return np.repeat(levels[..., None], 3, axis=3).astype(np.uint8), labels


def test_agreement_of_segmentations_leaves_out_ignored_pixels_and_absent_labels():
    truth = np.array([[0, 0, 1, 1], [0, 0, 255, 255]])
    labels = np.array([[0, 1, 1, 1], [0, 0, 0, 1]])
    found = segmentation_agreement(labels, truth)
    assert found.pixels == pytest.approx(5 / 6)
    assert found.mean_iou == pytest.approx((3 / 4 + 2 / 3) / 2)
    assert segmentation_agreement(truth, truth, ignore=None).mean_iou == 1
    assert np.isnan(segmentation_agreement(labels[:0], truth[:0]).pixels)
    with pytest.raises(ValueError, match="shape"):
        segmentation_agreement(labels[:1], truth)


def test_images_of_which_the_truth_says_nothing_are_left_out():
    images, labels = scenes(4)
    empty = np.full_like(labels[0], 255)
    rows = judge_downstream(
        Bright(), Halved(), images, [empty, *labels[1:]], np.zeros(4, dtype=np.int32)
    )
    assert rows[0].interval.value == pytest.approx(1)
    with pytest.raises(RequestError, match="no image"):
        judge_downstream(Bright(), Halved(), images[:1], [empty], np.zeros(1, dtype=np.int32))


def test_truths_are_labels_arrays_or_json(tmp_path):
    labels = scenes(1)[1][0]
    cv2.imwrite(str(tmp_path / "a.png"), labels)
    np.save(tmp_path / "b.npy", labels)
    (tmp_path / "c.json").write_text(json.dumps({"offset": 0.1}))
    assert (read_truth(tmp_path, "a.jpg") == labels).all()
    assert (read_truth(tmp_path, "b.jpg") == labels).all()
    assert read_truth(tmp_path, "c.jpg") == {"offset": 0.1}
    (tmp_path / "d.json").write_text("{")
    for name in ("d.jpg", "none.jpg"):
        with pytest.raises(RequestError, match=name[:-4]):
            read_truth(tmp_path, name)


@pytest.mark.parametrize("text", ["model", "no_such_module:MODEL", "json:no_name", "json:loads"])
def test_what_is_no_model_is_refused(text):
    with pytest.raises(RequestError, match="--downstream"):
        load_downstream(text)


def test_the_report_of_folders_scores_the_model(tmp_path, capsys, monkeypatch):
    images, labels = scenes(12)
    for name, content in (("camera", images), ("sim", images // 2), ("truth", labels)):
        (tmp_path / name).mkdir()
        for number, image in enumerate(content):
            cv2.imwrite(str(tmp_path / name / f"{number:02}.png"), image)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bright.py").write_text(
        "from tests.translator_evaluation.test_downstream import Bright\nMODEL = Bright()\n"
    )
    file = "look.safetensors"
    folders = ["--source", "camera", "--target", "sim"]
    assert main(["translate", "fit", "mkl", *folders, "--out", file]) == 0
    capsys.readouterr()
    report = ["translate", "report", file, *folders, "--downstream", "bright:MODEL"]
    assert main(report) == 2
    assert main([*report, "--truth", "truth"]) == 0
    assert "model behind the translator" in capsys.readouterr().out
    assert main([*report, "--truth", "truth", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)[0]["rows"]
    gain = next(row for row in rows if row["metric"] == "downstream_gain")
    assert gain["interval"]["value"] > 0.2

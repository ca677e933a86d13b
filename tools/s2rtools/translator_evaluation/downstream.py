"""Judge a translator by a model behind it: a detector, a segmentation network, a planner ...

The model gets each image as it is and translated, and scores both results against the same truth.
What counts is the difference, which is paired and has an interval. `segmentation_agreement` is a
score of label images.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, first_line
from s2rstore.files.input_files import read_bytes
from s2rstore.intervals import mean, paired_difference
from s2rstore.security.printable_text import printable
from s2rtools.translation.image_set import MAX_IMAGE_BYTES, Rgb
from s2rtools.translation.method import Translator
from s2rtools.translator_evaluation.measures import MetricRow, figure

_SUFFIXES = (".png", ".npy", ".json")


@runtime_checkable
class DownstreamModel(Protocol):
    """A model that works on images, and the score of its results.

    `predict(image)` gets an image (H, W, 3) uint8 RGB and returns any result. `score(result,
    truth)` returns a number, higher is better, or NaN where the truth says nothing.
    """

    def predict(self, image: Rgb) -> Any: ...
    def score(self, result: Any, truth: Any) -> float: ...


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement of two label images, each 0 .. 1; NaN where no pixel is compared.

    `pixels` is the share of pixels with the same label; `mean_iou` is the mean over the labels that
    either has of intersection over union.
    """

    pixels: float
    mean_iou: float


def segmentation_agreement(
    labels: NDArray[np.integer[Any]], truth: NDArray[np.integer[Any]], ignore: int | None = 255
) -> Agreement:
    """Agreement of labels (...) with true labels of the same shape, where these are not `ignore`.

    Raises ValueError where the shapes differ.
    """
    if labels.shape != truth.shape:
        raise ValueError(f"labels of shape {labels.shape}, the truth has {truth.shape}")
    compared = np.ones(truth.shape, dtype=np.bool_) if ignore is None else truth != ignore
    found, true = labels[compared], truth[compared]
    if not found.size:
        return Agreement(float("nan"), float("nan"))
    classes = np.union1d(found, true)
    shares = [
        np.count_nonzero((found == label) & (true == label))
        / np.count_nonzero((found == label) | (true == label))
        for label in classes
    ]
    return Agreement(float((found == true).mean()), float(np.mean(shares)))


def judge_downstream(
    model: DownstreamModel,
    translator: Translator,
    images: Iterable[Rgb],
    truths: Sequence[Any],
    recordings: NDArray[np.integer[Any]],
) -> list[MetricRow]:
    """Scores of a model on images (H, W, 3), translated and as they are, and the gain.

    `truths` belong to the images, `recordings` (N,) are codes of recordings of neighbouring images.
    Images of which the truth says nothing are left out. Raises RequestError where nothing is left.
    """
    scores = np.array(
        [
            [
                model.score(model.predict(seen), truth)
                for seen in (image, np.asarray(translator.translate(image[None])[0]))
            ]
            for image, truth in zip(images, truths, strict=True)
        ],
        dtype=np.float64,
    ).reshape(-1, 2)
    known = np.isfinite(scores).all(axis=1)
    if not known.any():
        raise RequestError("the model scores no image: no truth says anything")
    (plain, translated), groups = scores[known].T, recordings[known]
    return [
        figure("downstream_score", mean(translated, groups)),
        figure("downstream_score", mean(plain, groups), "identity"),
        figure("downstream_gain", paired_difference(translated - plain, groups)),
    ]


def load_downstream(text: str) -> DownstreamModel:
    """The model that `MODULE:NAME` names; modules are also found in the working folder.

    Raises RequestError where it cannot be loaded or is no `DownstreamModel`.
    """
    module, _, name = text.partition(":")
    if not module or not name:
        raise RequestError(f"--downstream {text}: name a module and its model, as in MODULE:NAME")
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        model = getattr(importlib.import_module(module), name)
    except Exception as error:  # code of others may raise anything
        message = f"--downstream {text}: cannot be loaded: {printable(first_line(error))}"
        raise RequestError(message) from error
    if isinstance(model, type) or not isinstance(model, DownstreamModel):
        raise RequestError(f"--downstream {text}: has no predict(image) and score(result, truth)")
    return model


def read_truth(folder: Path, image: str) -> Any:
    """The truth of an image by its name: an image or array of labels (.png, .npy), or JSON.

    Raises RequestError where there is none, or it is damaged.
    """
    base = folder / PurePath(image).with_suffix("")
    path = next((file for suffix in _SUFFIXES if (file := Path(f"{base}{suffix}")).is_file()), None)
    if path is None:
        raise RequestError(f"{base}{{{','.join(_SUFFIXES)}}}: no truth of {image}")
    content = read_bytes(path, MAX_IMAGE_BYTES)
    try:
        if path.suffix == ".json":
            return json.loads(content)
        if path.suffix == ".npy":
            return np.load(path, allow_pickle=False)
        labels = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except (ValueError, cv2.error) as error:
        raise RequestError(f"{path}: cannot be read ({printable(first_line(error))})") from error
    if labels is None:
        raise RequestError(f"{path}: cannot be decoded as an image")
    return labels

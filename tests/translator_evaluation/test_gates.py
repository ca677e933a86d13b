"""Gates: which damage of translated images is refused, and what is accepted."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from s2rtools.translation import METHODS
from s2rtools.translation.method import FitSettings
from s2rtools.translator_evaluation.measures import judge, measure_content
from tests.translation.palette_world import image_set
from tests.translator_evaluation.scenes import (
    Images,
    as_images,
    blurred,
    recoloured,
    rooms,
    with_object,
)

SOURCE = rooms(0, 12)
TARGET = recoloured(rooms(1, 12))
MAPPED = recoloured(SOURCE)


def reasons(translated: Images) -> str:
    verdict = judge(measure_content(SOURCE, translated, TARGET))
    assert verdict.passed == (not verdict.reasons)
    return "; ".join(verdict.reasons)


def inverted_lightness(images: Images) -> Images:
    lab = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2LAB) for image in images])
    lab[..., 0] = 255 - lab[..., 0]
    return np.stack([cv2.cvtColor(image, cv2.COLOR_LAB2RGB) for image in lab])


DAMAGE: dict[str, tuple[Callable[[Images], Images], str]] = {
    "constant": (lambda x: np.full_like(x, 128), "become alike"),
    "mean of the target": (
        lambda x: np.broadcast_to(as_images(TARGET.mean(axis=0)), x.shape), "become alike",
    ),
    "one repeated target": (lambda x: np.broadcast_to(TARGET[0], x.shape), "become alike"),
    "negative": (lambda x: 255 - x, "inverted"),
    "inverted lightness": (inverted_lightness, "inverted"),
    "every other image inverted": (
        lambda x: np.where(np.arange(len(x))[:, None, None, None] % 2, 255 - x, x), "inverted",
    ),
    "blur": (lambda x: blurred(x, 1.5), "blurred"),
    "strong blur": (lambda x: blurred(x, 4), "blurred"),
    "shuffled": (lambda x: np.roll(x, 5, axis=0), "own source"),
    "delayed by one image": (lambda x: np.roll(x, 1, axis=0), "own source"),
    "small object": (lambda x: with_object(x, 8), "structure"),
    "object": (lambda x: with_object(x, 20), "structure"),
    "object in every third image": (lambda x: with_object(x, 16, every=3), "structure"),
}  # fmt: skip


DEEP = {
    "mean of the target", "one repeated target", "every other image inverted", "strong blur",
    "delayed by one image", "object", "object in every third image",
}  # fmt: skip
"""Damage that differs from other damage with the same reason only in its extent."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.deep) if name in DEEP else name for name in DAMAGE],
)
def test_damage_is_refused_with_its_reason(name):
    damage, reason = DAMAGE[name]
    assert reason in reasons(damage(MAPPED))


@pytest.mark.parametrize("name", [name for name, method in METHODS.items() if not method.learned])
def test_methods_that_match_statistics_are_accepted(name):
    fitted = METHODS[name].fit(image_set(SOURCE), image_set(TARGET), FitSettings())
    assert not reasons(fitted.translator.translate(SOURCE))


def test_gamma_noise_and_vignette_are_accepted():
    assert not reasons(as_images(255 * (SOURCE / 255.0) ** 0.6))
    noise = np.random.default_rng(0).normal(0, 5, SOURCE.shape)
    assert not reasons(as_images(MAPPED + noise))
    columns = np.linspace(-1, 1, SOURCE.shape[2])[None, None, :, None]
    assert not reasons(as_images(MAPPED * (1 - 0.4 * columns**2)))


def test_a_blur_is_only_named_a_blur():
    assert "structure" not in reasons(blurred(MAPPED, 2))


def test_a_translator_may_blur_as_much_as_the_target_does():
    content = measure_content(SOURCE, blurred(MAPPED, 1.0), blurred(TARGET, 1.0))
    sharp = content | {"target_sharpness": 1.0}
    assert judge(content).passed
    assert not judge(sharp).passed


def test_an_excuse_by_the_target_is_limited():
    content = measure_content(SOURCE, blurred(MAPPED, 4), blurred(TARGET, 4))
    assert "blurred" in "; ".join(judge(content).reasons)


def test_unknown_metrics_are_not_judged():
    content = measure_content(SOURCE[:1], MAPPED[:1])
    assert np.isnan(content["diversity"])
    verdict = judge(content)
    assert verdict.passed
    assert "diversity" not in {check.metric for check in verdict.checks}

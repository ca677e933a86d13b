"""Translation methods that match statistics."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.translation import METHODS
from s2rtools.translation.colour_maps import HistogramTranslator
from s2rtools.translation.colour_statistics import from_lab, moments, to_lab, transport
from s2rtools.translation.method import FitSettings, blend
from tests.translation.palette_world import image_set

STATISTICAL = [name for name, method in METHODS.items() if not method.learned]
WITH_STATISTICS = [name for name in STATISTICAL if "statistics" in METHODS[name].options]
MATRIX = np.array([[0.8, 0.1, 0.05], [0.1, 0.6, 0.1], [0.05, 0.1, 0.9]])
OFFSET = np.array([20.0, 5.0, -10.0])


def smooth_images(seed: int, count: int = 12, size: int = 32) -> NDArray[np.uint8]:
    """Images of coloured blobs, with grey levels from about 30 to 220."""
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(30, 220, (count, size // 4, size // 4, 3))
    return np.rint(coarse.repeat(4, axis=1).repeat(4, axis=2)).astype(np.uint8)


def fit(name: str, source: NDArray[np.uint8], target: NDArray[np.uint8], **options: str):
    method = METHODS.find(name)
    return method.fit(image_set(source), image_set(target), FitSettings(options=options)).translator


def test_mkl_recovers_a_known_linear_map():
    rng = np.random.default_rng(0)
    colours = rng.multivariate_normal([120, 110, 130], np.diag([400.0, 300, 500]), 200_000)
    mapped = colours @ MATRIX.T + OFFSET
    found = transport(moments(colours.astype(np.float32)), moments(mapped.astype(np.float32)), 0.0)
    assert np.abs(found - MATRIX).max() < 1e-3


@pytest.mark.parametrize("name", STATISTICAL)
def test_identical_domains_change_little(name):
    images = smooth_images(3)
    translated = fit(name, images, images).translate(images).astype(float)
    # FDA and gray world move each image to the mean of all images.
    limit = 12.0 if name in ("fda", "grayworld") else 1.0
    assert np.abs(translated - images).mean() < limit


@pytest.mark.parametrize(
    ("name", "options"),
    [(name, {}) for name in STATISTICAL]
    + [(name, {"statistics": "image"}) for name in WITH_STATISTICS],
)
def test_restored_translators_give_the_same_images(name, options):
    source, target = smooth_images(4), smooth_images(5) // 2
    translator = fit(name, source, target, **options)
    restored = type(translator).restore(translator.tensors(), translator.settings())
    assert (restored.translate(source) == translator.translate(source)).all()


@pytest.mark.parametrize("name", WITH_STATISTICS)
def test_statistics_of_the_image_follow_the_light(name):
    target = smooth_images(6, 30)
    source = smooth_images(7, 30)
    dark = (source * np.array([0.5, 0.25, 0.35])).astype(np.uint8)
    translator = fit(name, source, target, statistics="image")
    difference = np.abs(
        translator.translate(dark).astype(float) - translator.translate(source)
    ).mean()
    fixed = fit(name, source, target)
    without = np.abs(fixed.translate(dark).astype(float) - fixed.translate(source)).mean()
    assert difference < without / 4


# Reinhard matches L*a*b*, in which a gain per RGB channel is not linear.
@pytest.mark.parametrize(("name", "share"), [("reinhard", 0.5), ("mkl", 0.1), ("histogram", 0.1)])
def test_a_colour_cast_is_undone(name, share):
    images = smooth_images(8, 40)
    cast = np.clip(images * np.array([0.6, 0.9, 0.4]) + 10, 0, 255).astype(np.uint8)
    before = np.abs(cast.astype(float) - images).mean()
    after = np.abs(fit(name, cast, images).translate(cast).astype(float) - images).mean()
    assert after < share * before


def test_gray_world_gives_every_image_the_mean_of_the_target():
    target = smooth_images(9)
    translated = fit("grayworld", target, target // 2).translate(target[:3])
    means = translated.reshape(3, -1, 3).mean(axis=1)
    assert np.abs(means - (target // 2).reshape(-1, 3).mean(axis=0)).max() < 1.5


def test_histograms_agree_after_matching():
    source, target = smooth_images(10, 40), (smooth_images(11, 40) // 2 + 60).astype(np.uint8)
    translated = fit("histogram", source, target).translate(source)
    shares = [HistogramTranslator.statistics(images, {}) for images in (translated, target)]
    assert np.abs(shares[0] - shares[1]).max() < 0.02


def test_fda_replaces_the_low_frequencies_only():
    source, target = smooth_images(12, 20) // 2 + 60, smooth_images(13, 20) // 2 + 90
    translated = fit("fda", source, target, beta="0.05").translate(source)
    assert abs(translated.mean() - target.mean()) < 2
    low = np.zeros((32, 32), dtype=bool)
    low[np.ix_([-1, 0, 1], [-1, 0, 1])] = True
    spectra = [np.fft.fft2(i.astype(float), axes=(1, 2)) for i in (source, translated)]
    change = np.abs(spectra[0] - spectra[1]).mean(axis=(0, 3))
    assert change[~low].mean() < 0.1 * change[low].mean()


@pytest.mark.parametrize("name", ["mkl", "fda"])
def test_other_sizes_than_that_of_the_fit_are_translated(name):
    source, target = smooth_images(14), smooth_images(15) // 2
    large = source.repeat(3, axis=1).repeat(2, axis=2)
    translated = fit(name, source, target).translate(large)
    assert translated.shape == large.shape
    assert abs(translated.mean() - target.mean()) < 10


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("mkl", {"statistics": "frame"}), ("fda", {"beta": "2"}), ("fda", {"beta": "wide"}),
        ("cyclegan", {"channels": "0"}), ("cyclegan", {"cycle": "nan"}),
        ("cyclegan", {"speed": "9"}),
    ],
)  # fmt: skip
def test_wrong_options_are_refused(name, options):
    with pytest.raises(RequestError, match=next(iter(options))):
        fit(name, smooth_images(0), smooth_images(1), **options)


@pytest.mark.parametrize("name", STATISTICAL)
def test_empty_image_sets_and_unknown_options_are_refused(name):
    images, empty = smooth_images(0), np.empty((0, 32, 32, 3), dtype=np.uint8)
    for source, target in ((images, empty), (empty, images)):
        with pytest.raises(RequestError, match="no images"):
            fit(name, source, target)
    with pytest.raises(RequestError, match="speed"):
        fit(name, images, images, speed="9")


def test_unknown_methods_name_the_known_ones():
    with pytest.raises(RequestError, match="mkl"):
        METHODS.find("vangogh")


@given(st.floats(0, 1), st.integers(0, 99))
def test_strength_blends_and_is_exact_at_both_ends(strength, seed):
    original, translated = smooth_images(seed, 2, 8), smooth_images(seed + 1, 2, 8)
    assert blend(original, translated, 0) is original
    assert (blend(original, translated, 1.0) == translated).all()
    mixed = blend(original, translated, strength).astype(float)
    expected = original + strength * (translated.astype(float) - original)
    assert np.abs(mixed - expected).max() <= 0.501


def test_lab_and_back_is_the_same_image():
    images = smooth_images(16)
    assert np.abs(from_lab(to_lab(images)).astype(int) - images).max() <= 1


def test_reinhard_has_the_statistics_of_all_pixels():
    images = smooth_images(17, 40)
    statistics = fit("reinhard", images, images).tensors()["target"]
    pixels = to_lab(images).reshape(-1, 3).astype(np.float64)
    expected = [pixels.mean(axis=0), pixels.std(axis=0)]
    np.testing.assert_allclose(statistics, expected, atol=1e-3)

"""Learned methods: what they learn on palettes, seeds, checkpoints, stored files."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from s2rstore.errors import RequestError
from s2rtools.translation import METHODS, fit_loop, network_translator, style_losses
from s2rtools.translation.adversarial_training import AdversarialLearner, luminance_loss
from s2rtools.translation.method import FitResult, FitSettings
from s2rtools.translation.translator_file import StoredTranslator, decode, encode
from tests.translation.palette_world import SIZE, counterparts, difference, image_set, unpaired

LEARNED = [name for name, method in METHODS.items() if method.learned]
GENERATIVE = ["cyclegan", "cut", "unit", "style-network", "mkl+residual"]
TINY = {"channels": "2", "blocks": "1"}
"""Size of networks of which only the handling is tested."""


def tiny_settings(name: str, steps: int = 4, **more: str) -> FitSettings:
    options = {"iterations": "2"} if name == "style" else dict(TINY)
    return FitSettings(seed=3, steps=steps, options=options | more)


@pytest.fixture(autouse=True)
def few_feature_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style_losses, "TRAINING_STEPS", 20)


@cache
def tiny_fit(name: str) -> FitResult:
    return METHODS.find(name).fit(*unpaired(), tiny_settings(name))


def test_an_untrained_generator_returns_its_input():
    images = counterparts(4)[0]
    settings = replace(tiny_settings("cyclegan"), steps=0)
    translator = METHODS.find("cyclegan").fit(*unpaired(), settings).translator
    np.testing.assert_array_equal(translator.translate(images), images)


@pytest.mark.parametrize("name", GENERATIVE)
def test_a_continued_fit_equals_an_uninterrupted_one(name, tmp_path):
    checkpoint = tmp_path / "fit.safetensors"
    steps = 0

    def interrupt(fraction: float, loss: float, seconds: float) -> None:
        nonlocal steps
        steps += 1
        if steps == 2:
            raise KeyboardInterrupt

    settings = replace(tiny_settings(name), checkpoint=checkpoint)
    with pytest.raises(KeyboardInterrupt):
        METHODS.find(name).fit(*unpaired(), replace(settings, report=interrupt))
    continued = METHODS.find(name).fit(*unpaired(), settings)
    uninterrupted = tiny_fit(name)
    assert continued.history == uninterrupted.history
    for key, value in uninterrupted.translator.tensors().items():
        np.testing.assert_array_equal(continued.translator.tensors()[key], value)


@pytest.mark.parametrize("saved_every_seconds", [0.0, 1000.0])
def test_a_fit_continues_after_an_interrupt_inside_a_step(
    saved_every_seconds, tmp_path, monkeypatch
):
    updates = []

    def interrupted(learner, loss, name="all"):
        updates.append(name)
        if updates.count("discriminators") == 2:
            raise KeyboardInterrupt
        update(learner, loss, name)

    update = AdversarialLearner.update
    settings = replace(tiny_settings("cut"), checkpoint=tmp_path / "fit.safetensors")
    monkeypatch.setattr(fit_loop, "CHECKPOINT_SECONDS", saved_every_seconds)
    with monkeypatch.context() as patch:
        patch.setattr(AdversarialLearner, "update", interrupted)
        with pytest.raises(KeyboardInterrupt):
            METHODS.find("cut").fit(*unpaired(), settings)
    assert updates == ["generators", "discriminators"] * 2
    continued = METHODS.find("cut").fit(*unpaired(), settings).translator.tensors()
    for key, value in tiny_fit("cut").translator.tensors().items():
        np.testing.assert_array_equal(continued[key], value)


def test_the_checkpoint_of_another_fit_is_refused_and_kept(tmp_path):
    settings = replace(tiny_settings("cut"), checkpoint=tmp_path / "fit.safetensors")
    other = replace(settings, seed=settings.seed + 1)
    METHODS.find("cut").fit(*unpaired(), other)
    before = settings.checkpoint.read_bytes()
    with pytest.raises(RequestError, match=r"checkpoint of another fit \(other seed\)"):
        METHODS.find("cut").fit(*unpaired(), settings)
    options = {**settings.options, "rate": "0.001"}
    with pytest.raises(RequestError, match="learning_rate"):
        METHODS.find("cut").fit(*unpaired(), replace(other, options=options))
    assert settings.checkpoint.read_bytes() == before


@pytest.mark.parametrize("name", LEARNED)
def test_stored_translators_give_the_same_images(name):
    translator = tiny_fit(name).translator
    content = encode(StoredTranslator(translator, "first", "second", (SIZE, SIZE)))
    restored = decode(content, "file").translator
    images = counterparts(3)[0]
    np.testing.assert_array_equal(restored.translate(images), translator.translate(images))
    assert encode(StoredTranslator(restored, "first", "second", (SIZE, SIZE))) == content


@pytest.mark.parametrize("name", LEARNED)
@pytest.mark.parametrize("size", [(30, 17), (5, 64), (1, 1)])
def test_images_of_other_sizes_keep_their_size(name, size):
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (2, *size, 3), dtype=np.uint8)
    translated = tiny_fit(name).translator.translate(images)
    assert translated.shape == images.shape
    assert translated.dtype == np.uint8


@pytest.mark.parametrize("name", LEARNED)
def test_a_translation_does_not_depend_on_the_other_images(name):
    translator, images = tiny_fit(name).translator, counterparts(3)[0]
    np.testing.assert_array_equal(
        translator.translate(images)[1:2], translator.translate(images[1:2])
    )


def test_edges_of_larger_images_stay_sharp():
    large = counterparts(2)[0].repeat(4, axis=1).repeat(4, axis=2)
    translated = tiny_fit("cyclegan").translator.translate(large)
    sharpness = [
        np.abs(np.diff(x.mean(axis=3), axis=2)).max() for x in (large.astype(float), translated)
    ]
    assert sharpness[1] > 0.8 * sharpness[0]


@pytest.mark.parametrize("name", LEARNED)
def test_constant_and_single_images_can_be_fitted(name):
    constant = image_set(np.full((1, 16, 24, 3), 90, dtype=np.uint8))
    other = image_set(counterparts(1)[1][:, :16, :24])
    translated = METHODS.find(name).fit(constant, other, tiny_settings(name, 2)).translator
    assert translated.translate(constant.images).shape == constant.images.shape


@pytest.mark.parametrize("name", LEARNED)
def test_files_with_a_wrong_size_are_refused(name):
    translator = tiny_fit(name).translator
    for size in ([0, 8], "8x8", [8], [1025, 8]):
        content = altered(translator, {"size": size, "network": translator.settings()["network"]})
        with pytest.raises(RequestError, match="damaged"):
            decode(content, "file")


@pytest.mark.parametrize(
    ("name", "network"),
    [
        ("cyclegan", {"channels": 10**6, "blocks": 1, "bound": 2.0}),
        ("cyclegan", {"channels": 2, "blocks": 10**6, "bound": 2.0}),
        ("cut", {"channels": 2, "blocks": 1, "bound": 1e9}),
        ("cut", {"channels": 3, "blocks": 1, "bound": 2.0}),
        ("unit", {"channels": "2", "blocks": 1, "bound": 2.0}),
        ("unit", {"channels": 2, "blocks": 1, "bound": 2.0, "more": 1}),
        ("mkl+residual", {"channels": True, "blocks": 1, "bound": 0.5}),
        ("style", {"layout": "vgg99", "iterations": 2, "weight": 1.0}),
        ("style", {"layout": "small", "iterations": 10**9, "weight": 1.0}),
        ("style", {"layout": "small", "iterations": 301, "weight": 1.0}),
        ("style-network", 7),
    ],
)
def test_files_with_wrong_network_settings_are_refused(name, network):
    with pytest.raises(RequestError, match="damaged"):
        decode(altered(tiny_fit(name).translator, {"size": [32, 32], "network": network}), "file")


def altered(translator, settings) -> bytes:
    """File of a translator with other settings."""

    class Altered(type(translator)):
        def settings(self):
            return settings

    changed = Altered.__new__(Altered)
    changed.__dict__ = translator.__dict__
    return encode(StoredTranslator(changed, "first", "second", (SIZE, SIZE)))


@pytest.mark.parametrize(
    ("name", "network"),
    [
        ("unit", {"channels": 128, "blocks": 16, "bound": 2.0}),
        ("style", {"layout": "vgg19", "iterations": 2, "weight": 1.0}),
    ],
)
def test_networks_larger_than_their_tensors_are_not_built(name, network, monkeypatch):
    content = altered(tiny_fit(name).translator, {"size": [32, 32], "network": network})
    built = []
    method = type(tiny_fit(name).translator)
    build = method.build

    def recorded(settings):
        built.append(build(settings))
        return built[-1]

    monkeypatch.setattr(method, "build", recorded)
    with pytest.raises(RequestError, match="damaged"):
        decode(content, "file")
    assert all(value.is_meta for network in built for value in network.parameters())


def test_working_sizes_that_need_too_much_memory_are_refused():
    wide = METHODS.find("cut").fit(*unpaired(), FitSettings(steps=0, options={"channels": "33"}))
    network = wide.translator.settings()["network"]
    decode(altered(wide.translator, {"size": [8, 1000], "network": network}), "file")
    with pytest.raises(RequestError, match="at most 1008 pixels"):
        decode(altered(wide.translator, {"size": [8, 1024], "network": network}), "file")


def test_a_fit_that_needs_too_much_memory_is_refused():
    large = image_set(np.zeros((1, 8, 1024, 3), dtype=np.uint8))
    with pytest.raises(RequestError, match="fit at a smaller size"):
        METHODS.find("cut").fit(large, large, FitSettings(steps=0, options={"channels": "33"}))


def test_small_images_are_not_enlarged():
    """They are translated alike, however large the images of the fit were."""
    translator, small = tiny_fit("cut").translator, counterparts(1)[0][:, :20, :24]
    settings = translator.settings() | {"size": [64, 64]}
    larger = decode(altered(translator, settings), "file").translator
    np.testing.assert_array_equal(larger.translate(small), translator.translate(small))


def test_sizes_and_pairs_that_do_not_match_are_refused():
    first, second = unpaired()
    small = image_set(second.images[:, :16])
    with pytest.raises(RequestError, match="same size"):
        METHODS.find("cut").fit(first, small, tiny_settings("cut"))
    fewer = image_set(second.images[:5])
    with pytest.raises(RequestError, match="not pairs"):
        METHODS.find("mkl+residual").fit(
            first, fewer, replace(tiny_settings("mkl+residual"), paired=True)
        )


def test_the_precision_of_slow_translators_is_not_compared(monkeypatch):
    translator, images = tiny_fit("cut").translator, counterparts(1)[0]
    calls = []
    monkeypatch.setattr(network_translator, "_SLOW", 0.0)
    monkeypatch.setattr(type(translator), "translate", lambda self, rgb: calls.append(1))
    translator.use_faster_precision(images)
    assert len(calls) == 1
    assert translator.precision == torch.float32


def test_a_faster_precision_changes_images_by_a_grey_level_at_most():
    content = encode(StoredTranslator(tiny_fit("cyclegan").translator, "a", "b", (SIZE, SIZE)))
    translator = decode(content, "file").translator
    images = counterparts(2)[0]
    exact = translator.translate(images).astype(float)
    translator.use_faster_precision(images)
    assert np.abs(translator.translate(images) - exact).mean() < 1


SMALL = {"channels": "8", "blocks": "2", "batch": "2"}


# Steps, learning rate and the share of the identity's distance to the true counterparts that is to
# be reached.
@pytest.mark.parametrize(
    ("name", "steps", "rate", "share"),
    [
        ("cut", 150, "5e-4", 0.9),
        pytest.param("cyclegan", 100, "1e-3", 0.8, marks=pytest.mark.deep),
        pytest.param("unit", 100, "1e-3", 0.95, marks=pytest.mark.deep),
    ],
)
def test_adversarial_methods_come_closer_to_the_true_counterpart(name, steps, rate, share):
    settings = FitSettings(seed=0, steps=steps, options={**SMALL, "rate": rate})
    translator = METHODS.find(name).fit(*unpaired(), settings).translator
    first, second = counterparts()
    assert difference(translator.translate(first), second) < share * difference(first, second)


def test_the_luminance_loss_tells_bright_from_dark():
    image = torch.rand(2, 3, 8, 8, generator=torch.Generator().manual_seed(0)) * 2 - 1
    assert luminance_loss(image * 0.5 + 0.2, image) < 0.01
    assert luminance_loss(-image, image) > 1.99
    assert abs(float(luminance_loss(torch.zeros_like(image), image)) - 1) < 1e-3

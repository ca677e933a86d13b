"""The threshold study: splits without leaks, intervals, shares, verdicts and words."""

from dataclasses import replace

import numpy as np
import pytest

from examples.duckietown.line_scores import agreement, mean_f1
from examples.duckietown.report import in_words, to_table
from examples.duckietown.road_images import RoadImages
from examples.duckietown.split import split_images
from examples.duckietown.study import Choice, Study, pick_variant, sim_thresholds, verdict
from examples.duckietown.variant_evaluation import Evaluation, Scores
from examples.duckietown.variants import TranslatorCache, Variant, parse_sources, variants_of

TRUE = 100
"""True pixels per colour and image."""


def scores(name: str, hits: object, absent_red: int | None = None) -> Scores:
    """Scores of images without false pixels of white and yellow: `hits` (n,) of `TRUE` pixels.

    Red has the same hits, or, with `absent_red`, no true pixel and that many false ones.
    """
    found = np.broadcast_to(np.asarray(hits, dtype=np.float64)[:, None], (len(hits), 3))
    pixels = np.stack([found, np.zeros_like(found), TRUE - found], axis=-1)
    if absent_red is not None:
        pixels[:, 2] = 0, absent_red, 0
    empty = np.zeros((len(found), 3, 5))
    return Scores(name, "labelled" not in name, pixels, empty, np.full((len(found), 2), np.nan))


def study(
    variants: dict[str, object], recordings: int, images: int = 4, absent_red: int | None = None
) -> Study:
    """An study on recordings of equal length; the chosen variant is `sim+ai`."""
    count = recordings * images
    names = np.repeat([f"r{number}" for number in range(recordings)], images)
    defaults = {"default": 0.5, "default+ai": 0.5, "sim": 0.5, "sim+ai": 0.5}
    all_variants = {**defaults, "oracle per light": 1.0, **variants}
    facts = {
        "fitted_on_judged_recordings": [], "fitted_on_judged_images": [],
        "lights_with_plausible_detections": [],
    }  # fmt: skip
    return Study(
        np.full(count, "day"), names,
        {
            name: scores(name, TRUE * np.broadcast_to(share, count), absent_red)
            for name, share in all_variants.items()
        },
        Choice(Variant("sim+ai"), Variant("sim+ai"), {}), {"all": np.arange(count)}, facts,
    )  # fmt: skip


def f1_of(share: float) -> float:
    """F1 of a share of hits without false pixels."""
    return 2 * share / (1 + share)


def test_agreement_is_the_mean_over_colours_that_either_mask_has():
    counts = np.array([[90, 10, 10], [0, 0, 0], [0, 1, 0]], dtype=np.float64)
    assert agreement(counts) == pytest.approx(0.45)
    assert agreement(counts[:2]) == pytest.approx(0.9)
    assert np.isnan(agreement(np.zeros((3, 3))))


def test_gap_closed_is_the_share_between_simulation_and_oracle():
    of = study({"sim": 0.2, "sim+ai": 0.5, "oracle per light": 0.9}, 6)
    expected = (f1_of(0.5) - f1_of(0.2)) / (f1_of(0.9) - f1_of(0.2))
    assert of.gap_closed("sim+ai", "all") == pytest.approx(expected)
    assert of.gap_closed("sim", "all") == 0
    small = study({"sim": 0.89, "oracle per light": 0.9}, 6)
    assert np.isnan(small.gap_closed("sim+ai", "all"))


@pytest.mark.parametrize(("share", "spared"), [(0.75, True), (0.70, False)])
def test_spared_is_an_interval_that_reaches_the_oracle(share, spared):
    spread = np.repeat(np.linspace(-0.04, 0.04, 8), 4)
    of = study({"sim+ai": share + spread, "oracle per light": 0.765}, 8)
    assert verdict(of, "all")["f1"] < verdict(of, "all")["oracle"]
    assert verdict(of, "all")["spared"] is spared
    assert ("calibration spared" in in_words(of)) is spared


def test_the_smallest_number_of_labelled_images_that_wins_is_named():
    spread = np.repeat(np.linspace(-0.04, 0.04, 8), 4)
    of = study(
        {
            "sim+ai": 0.7 + spread, "1 labelled (per light)": 0.6 + spread,
            "2 labelled (per light)": 0.8 + spread, "4 labelled (per light)": 0.9 + spread,
        },
        8,
    )  # fmt: skip
    assert verdict(of, "all")["labels_that_win"] == 2
    assert verdict(of, "all")["labels_tested"] == [1, 2, 4]
    assert "wins from 2 labelled" in in_words(of)
    none = study({"sim+ai": 0.7 + spread, "1 labelled (per light)": 0.6 + spread}, 8)
    assert verdict(none, "all")["labels_that_win"] is None
    assert "Of 1 labelled images per light, none is better" in in_words(none)
    untested = in_words(study({"sim+ai": 0.7 + spread}, 8))
    assert "No number of labelled images was tested" in untested
    assert "none is better" not in untested


def test_one_recording_gives_an_interval_within_it_and_no_verdict():
    varied = np.linspace(0.5, 0.9, 16)
    labelled = {"1 labelled (per light)": varied + 0.1}
    of = study({"sim+ai": varied, **labelled}, 1, images=16)
    found = verdict(of, "all")
    assert found["spared"] is None
    assert found["labels_that_win"] is None
    assert found["low"] < found["f1"] < found["high"]
    assert "one recording: no interval between recordings" in in_words(of)
    assert "calibration spared" not in in_words(of)
    assert "pieces of one recording, intervals within it" in to_table(of)


def blank_images(labelled: np.ndarray, sequences: np.ndarray) -> RoadImages:
    """Black images of one light without lines."""
    count = len(labelled)
    return RoadImages(
        "road", np.zeros((count, 80, 160, 3), np.uint8), np.zeros((count, 80, 160), np.uint8),
        labelled, np.full(count, "night"), sequences, tuple("x" * count),
        np.full((count, 2), np.nan),
    )  # fmt: skip


def test_fits_on_judged_recordings_and_images_are_known():
    everything, half = np.ones(16, dtype=bool), np.arange(16) % 2 == 0
    two, one = np.repeat(["a", "b"], 8), np.full(16, "a")
    apart = split_images(blank_images(everything, two))
    assert apart.lights_fitted_on_judged_recordings() == []
    unlabelled = split_images(blank_images(half, one))
    assert unlabelled.lights_fitted_on_judged_recordings() == ["night"]
    assert unlabelled.lights_fitted_on_judged_images() == []
    whole = split_images(blank_images(everything, one))
    assert whole.lights_fitted_on_judged_images() == ["night"]


def variant(text: str) -> Variant:
    return Variant("sim", parse_sources(text)[0], "real2sim", "light")


def test_the_choice_is_the_best_mean_that_does_no_harm_in_ordinary_lights():
    results = {
        Variant("sim"): np.array([0.95, 0.1]), variant("reinhard"): np.array([0.90, 0.9]),
        variant("mkl"): np.array([0.94, 0.6]), variant("levels"): np.array([0.94, 0.5]),
    }  # fmt: skip
    choice = pick_variant(results, lambda _: 1.0)
    assert choice.unguarded == variant("mkl")
    assert choice.variant == replace(variant("mkl"), guarded=True)
    assert list(choice.candidates) == [
        "reinhard (light) > sim", "mkl (light) > sim", "levels (light) > sim", "sim",
    ]  # fmt: skip
    assert choice.candidates["mkl (light) > sim"] == pytest.approx(0.77)


def test_recordings_for_fitting_are_never_judged(rendered):
    split = split_images(rendered)
    judged = set(rendered.sequences[split.judged])
    for light in split.lights:
        for scope in ("light", "all", "others"):
            assert not judged & set(rendered.sequences[split.fit_rows(light, scope)])
        assert light not in rendered.conditions[split.fit_rows(light, "others")]


def test_labels_for_tuning_never_come_from_judged_images(rendered):
    for images in (rendered, replace(rendered, sequences=rendered.conditions)):
        split = split_images(images)
        judged = np.concatenate([part.judged for part in split.parts])
        assert sorted(judged) == list(split.judged)
        for part in split.parts:
            assert not set(part.judged) & set(part.tuned)
            together = [each.judged for each in split.parts if each.half == part.half]
            assert not set(np.concatenate(together)) & set(split.tuning_rows(part))


def test_levels_recover_the_dark_without_labels(rendered, tmp_path):
    sim = rendered.rows(rendered.conditions == "day")
    split = split_images(rendered.rows(rendered.conditions == "dark"))
    evaluation = Evaluation(split, sim, TranslatorCache(tmp_path), sim_thresholds(sim))
    variants = variants_of(parse_sources("levels"), 1)
    chosen = next(each for each in variants if each.thresholds == "sim" and each.source)
    alone = mean_f1(evaluation.variant(Variant("sim")).pixels.sum(axis=0))
    oracle = mean_f1(evaluation.oracle(per_light=True).pixels.sum(axis=0))
    assert mean_f1(evaluation.variant(chosen).pixels.sum(axis=0)) > alone + 0.3
    assert oracle > alone
    assert list(tmp_path.glob("levels-*.safetensors"))

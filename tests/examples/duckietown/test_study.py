"""The threshold study: splits without leaks, and variants that are fitted without labels."""

from dataclasses import replace

import numpy as np

from examples.duckietown.line_scores import mean_f1
from examples.duckietown.split import split_images
from examples.duckietown.study import sim_thresholds
from examples.duckietown.variant_evaluation import Evaluation
from examples.duckietown.variants import (
    TranslatorCache,
    Variant,
    parse_sources,
    variants_of,
)


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
    cache = TranslatorCache(tmp_path)
    evaluation = Evaluation(split, sim, cache, sim_thresholds(sim))
    variants = variants_of(parse_sources("levels"), 1)
    alone = mean_f1(evaluation.variant(Variant("sim")).pixels.sum(axis=0))
    through = evaluation.variant(
        next(variant for variant in variants if variant.thresholds == "sim" and variant.source)
    )
    oracle = mean_f1(evaluation.oracle(per_light=True).pixels.sum(axis=0))
    assert mean_f1(through.pixels.sum(axis=0)) > alone + 0.3
    assert oracle > alone
    assert list(tmp_path.glob("levels-*.safetensors"))
    again = Evaluation(split, sim, TranslatorCache(tmp_path), sim_thresholds(sim))
    repeated = again.variant(
        next(variant for variant in variants if variant.thresholds == "sim" and variant.source)
    )
    assert np.array_equal(through.pixels, repeated.pixels)

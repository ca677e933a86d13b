"""Does translation spare the calibration of colour thresholds?

Label-free variants (default and simulation-tuned thresholds, each alone and with every translator)
are compared on labelled real images with thresholds that are tuned on labels. One label-free
variant is chosen without any label of the real images, by its mean F1 on simulated images in
simulated lights (`choose_variant`). The units of intervals are recordings, or pieces of them where
there are too few; differences are paired.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from examples.duckietown.conditions import CONDITIONS
from examples.duckietown.line_detector import COLOURS, Bools, Thresholds, anti_instagram
from examples.duckietown.line_scores import f1, mean_f1, true_colours
from examples.duckietown.road_images import RoadImages
from examples.duckietown.split import (
    Rows,
    Split,
    simulated_lights,
    split_images,
)
from examples.duckietown.tuning import tune
from examples.duckietown.variant_evaluation import Evaluation, Scores
from examples.duckietown.variants import (
    BASELINE,
    FIT_SCOPES,
    Scope,
    Source,
    TranslatorCache,
    Variant,
    variants_of,
)
from s2rstore.errors import RequestError
from s2rstore.intervals import Interval, of_units
from s2rtools.common.blocks import Blocks, split_into_blocks
from s2rtools.common.command_line.progress import Reporter

Floats = NDArray[np.float64]

SIM_TUNED = "sim"
ORACLE = "oracle per light"
LABEL_COUNTS = (1, 2, 3, 4, 8)
HARD_BELOW = 0.8
"""A light is hard where the default thresholds with anti-instagram stay below this F1."""
_INDISTINCT = 0.02
"""Difference of mean F1 on simulated lights that is no reason to prefer a variant."""
_ORDINARY = 0.6
"""F1 of simulation-tuned thresholds in a simulated light that is ordinary."""
_HARMLESS = 0.02
"""Loss of mean F1 in ordinary simulated lights that a variant may cause."""
_MIN_GAP = 0.02
"""Distance of oracle and simulation-tuned thresholds below which no share of it is stated."""


@dataclass(frozen=True, slots=True)
class StudySettings:
    """Seeds of learned fits and of draws, minutes per learned fit, a folder for translators, the
    translators, and the real images on which they are fitted."""

    seeds: int = 3
    minutes: float | None = None
    cache: Path | None = None
    sources: tuple[Source, ...] = ()
    scopes: tuple[Scope, ...] = FIT_SCOPES


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """The label-free variant that was chosen, the same without its guard, and the mean F1 of all
    candidates on simulated lights, best first."""

    variant: Variant
    unguarded: Variant
    candidates: dict[str, float]


@dataclass(slots=True, eq=False)
class Study:
    """Scores of all variants on the judged images; `groups` are rows of the scores by name."""

    lights: NDArray[np.str_]
    sequences: NDArray[np.str_]
    scores: dict[str, Scores]
    choice: Choice
    groups: dict[str, Rows]
    facts: dict[str, Any]
    skipped: dict[str, str] = field(default_factory=dict)

    @property
    def chosen(self) -> str:
        return self.choice.variant.name

    def recordings(self, group: str) -> int:
        """Number of recordings of a group."""
        return len(set(self.sequences[self.groups[group]].tolist()))

    def unit(self, group: str) -> str:
        """The units of the intervals of a group."""
        recordings, blocks = self.recordings(group), self.blocks(group)
        if blocks.by_trajectory:
            return f"{recordings} recordings"
        pieces = f"{blocks.unit_count} piece{'s' if blocks.unit_count > 1 else ''}"
        return f"{pieces} of {'one recording' if recordings == 1 else f'{recordings} recordings'}"

    def true_colours(self, group: str) -> Bools:
        """Which colours (colours,) have true pixels in a group; the same for all variants."""
        return true_colours(next(iter(self.scores.values())).pixels[self.groups[group]])

    def counts(self, name: str, group: str) -> Floats:
        """Pixel counts (colours, 3) of a variant, summed over a group."""
        return np.asarray(self.scores[name].pixels[self.groups[group]].sum(axis=0))

    def blocks(self, group: str) -> Blocks:
        """Blocks of recordings of a group."""
        codes = np.unique(self.sequences[self.groups[group]], return_inverse=True)[1]
        order = np.argsort(codes, kind="stable")
        length = int(np.ceil(np.sqrt(len(codes) / len(set(codes.tolist())))))
        return split_into_blocks(codes[order], length)

    def _without_units(self, name: str, group: str, blocks: Blocks) -> Floats:
        """Pixel counts (U, colours, 3) without each unit."""
        rows = self.groups[group]
        order = np.argsort(np.unique(self.sequences[rows], return_inverse=True)[1], kind="stable")
        sums = blocks.sums(self.scores[name].pixels[rows[order]])
        units = np.zeros((blocks.unit_count, *sums.shape[1:]))
        np.add.at(units, blocks.units, sums)
        return np.asarray(units.sum(axis=0) - units)

    def f1(self, name: str, group: str, colour: str | None = None) -> Interval:
        """F1 of a variant on a group: of a colour, or the mean over the group's true colours.

        There is no interval where one unit has all pixels of one of these colours.
        """
        return self._interval({name: 1.0}, group, colour, (0.0, 1.0))

    def difference(self, name: str, other: str, group: str, colour: str | None = None) -> Interval:
        """Paired difference of F1 between two variants."""
        if name == other:
            return Interval(0.0, 0.0, 0.0)
        return self._interval({name: 1.0, other: -1.0}, group, colour, (-1.0, 1.0))

    def _interval(
        self, weights: Mapping[str, float], group: str, colour: str | None,
        ends: tuple[float, float],
    ) -> Interval:  # fmt: skip
        blocks, colours = self.blocks(group), self.true_colours(group)
        value, left_out = 0.0, np.zeros(blocks.unit_count)
        for name, weight in weights.items():
            value += weight * _score(self.counts(name, group), colour, colours).item()
            without = self._without_units(name, group, blocks)
            left_out = left_out + weight * _score(without, colour, colours)
        return of_units(value, left_out, unit="recordings or pieces of them").clipped(*ends)

    def gap_closed(self, name: str, group: str, oracle: str = ORACLE) -> float:
        """(F - F_sim) / (F_oracle - F_sim) with the thresholds tuned on simulation as F_sim; NaN
        where the oracle is hardly better."""
        colours = self.true_colours(group)
        of, sim, best = (
            _score(self.counts(each, group), None, colours).item()
            for each in (name, SIM_TUNED, oracle)
        )
        return (of - sim) / (best - sim) if best - sim > _MIN_GAP else float("nan")


def _score(counts: Floats, colour: str | None, colours: Bools) -> Floats:
    if colour is None:
        return mean_f1(counts, colours)
    return np.asarray(f1(counts[..., COLOURS.index(colour), :]))


def run_study(
    sim: RoadImages, real: RoadImages, settings: StudySettings, progress: Reporter
) -> Study:
    """Evaluate all variants.

    Raises RequestError where labels are missing or a method is not usable.
    """
    if not sim.labelled.any():
        raise RequestError(f"{sim.name}: --sim has no labelled images")
    split = split_images(real)
    cache = TranslatorCache(settings.cache, progress.say)
    choice = choose_variant(sim, settings, progress, split)
    evaluation = Evaluation(
        split, sim, cache, sim_thresholds(sim), settings.minutes, settings.seeds
    )
    variants = variants_of(list(settings.sources), len(split.lights), settings.scopes)
    variants += [
        variant for variant in (choice.unguarded, choice.variant) if variant not in variants
    ]
    progress.begin("variants", len(variants) + 2 + 2 * len(LABEL_COUNTS))
    scores: dict[str, Scores] = {}
    skipped: dict[str, str] = {}
    for variant in variants:
        try:
            scores[variant.name] = evaluation.variant(variant)
        except RequestError as error:
            if variant == choice.variant:
                raise
            skipped[variant.name] = str(error)
        progress.advance(1)
    for per_light in (False, True):
        oracle = evaluation.oracle(per_light)
        scores[oracle.name] = oracle
        progress.advance(1)
        for count in LABEL_COUNTS:
            labelled = evaluation.labelled(count, per_light)
            if labelled is not None:
                scores[labelled.name] = labelled
            progress.advance(1)
    lights = real.conditions[split.judged]
    facts = {
        "judged": len(split.judged), "lights": split.lights,
        "fitted_images": int(sum(len(rows) for rows in split.fitted.values())),
        "fitted_on_judged_recordings": split.lights_fitted_on_judged_recordings(),
        "fitted_on_judged_images": split.lights_fitted_on_judged_images(),
        "lights_with_plausible_detections": evaluation.plausible_lights(),
        "sim": len(sim), "seeds": settings.seeds, "minutes": settings.minutes,
    }  # fmt: skip
    groups = _groups(lights, scores[BASELINE])
    sequences = real.sequences[split.judged]
    return Study(lights, sequences, scores, choice, groups, facts, skipped)


def sim_thresholds(sim: RoadImages) -> dict[str, Thresholds]:
    """Ranges tuned on labelled simulated images, without and with the anti-instagram map."""
    labelled = sim.rows(sim.labelled)
    return {
        "sim": tune(labelled.images, labelled.masks).thresholds,
        "sim+ai": tune(anti_instagram(labelled.images), labelled.masks).thresholds,
    }


def choose_variant(
    sim: RoadImages,
    settings: StudySettings,
    progress: Reporter,
    real: Split,
    draws: int = 2,
) -> Choice:
    """A label-free variant by its F1 over simulated lights and its stability on real images.

    It is the variant with the best mean over all lights among those that do no harm in ordinary
    lights, which the simulation-tuned thresholds alone can deal with: there its mean is at
    most `_HARMLESS` below that of these thresholds. Translators are fitted per simulated light on
    another recording than the judged one. Of the variants within `_INDISTINCT` of the best mean,
    the one is taken whose masks of unlabelled real images depend least on what is in view
    (`Evaluation.stability`). Learned methods and files take no part: they would need a fit per
    simulated light.

    A chosen translator is guarded (`Variant.guarded`): where the plain detector works, as far as
    this can be known without labels, no translator can help much, and it may harm.
    """
    tuned = sim_thresholds(sim)
    sources = [each for each in settings.sources if not each.learned and each.file is None]
    variants = [
        variant
        for variant in variants_of(sources, len(CONDITIONS))
        if variant.direction == "none"
        or (variant.direction == "real2sim" and variant.scope in ("light", "image")
            and variant.thresholds == SIM_TUNED)
    ]  # fmt: skip
    progress.begin("choice on simulated lights", draws * len(variants))
    results: dict[Variant, list[list[float]]] = {variant: [] for variant in variants}
    for draw in range(draws):
        lit = simulated_lights(sim, draw)
        split = split_images(lit)
        evaluation = Evaluation(split, sim, TranslatorCache(None), tuned, pixels_only=True)
        for variant in variants:
            scores = evaluation.variant(variant)
            by_light = [
                float(mean_f1(scores.pixels[lit.conditions[split.judged] == light].sum(axis=0)))
                for light in split.lights
            ]
            results[variant].append(by_light)
            progress.advance(1)
    by_light_of = {variant: np.nanmean(values, axis=0) for variant, values in results.items()}
    evaluation = Evaluation(real, sim, TranslatorCache(None), tuned)
    return pick_variant(by_light_of, evaluation.stability)


def pick_variant(
    by_light_of: Mapping[Variant, Floats], stability: Callable[[Variant], float]
) -> Choice:
    """The variant that `choose_variant` describes, from the F1 (lights,) of each on simulated
    lights. `stability` is asked only for variants near the best. Simulation-tuned thresholds alone
    take part.
    """
    alone = by_light_of[Variant(SIM_TUNED)]
    ordinary = alone >= _ORDINARY
    means = {variant: float(np.nanmean(values)) for variant, values in by_light_of.items()}
    harmless = [
        variant
        for variant, values in by_light_of.items()
        if not ordinary.any() or values[ordinary].mean() >= alone[ordinary].mean() - _HARMLESS
    ]
    best = max(means[variant] for variant in harmless)
    near = [variant for variant in harmless if means[variant] >= best - _INDISTINCT]
    chosen = max(near, key=lambda variant: (stability(variant), means[variant]))
    ranked = sorted(means, key=lambda variant: -means[variant])
    guarded = chosen if chosen.source is None else replace(chosen, guarded=True)
    return Choice(guarded, chosen, {variant.name: means[variant] for variant in ranked})


def _groups(lights: NDArray[np.str_], baseline: Scores) -> dict[str, Rows]:
    """All judged rows, those of each light, and those of ordinary and of hard lights.

    Hard lights are known by the baseline's F1 on the same rows: by chance alone its F1 in them is
    too low, and the difference of another variant to it too high; in ordinary lights the reverse.
    """
    groups = {"all": np.arange(len(lights))}
    hard = np.zeros(len(lights), dtype=np.bool_)
    for light in sorted(set(lights.tolist())):
        rows = np.flatnonzero(lights == light)
        groups[light] = rows
        hard[rows] = mean_f1(baseline.pixels[rows].sum(axis=0)) < HARD_BELOW
    if hard.any() and not hard.all():
        groups = {
            "all": groups.pop("all"), "ordinary lights": np.flatnonzero(~hard),
            "hard lights": np.flatnonzero(hard), **groups,
        }  # fmt: skip
    return groups


def verdict(
    study: Study, group: str, colour: str | None = None, name: str | None = None
) -> dict[str, Any]:
    """Whether the chosen variant spares the calibration on a group.

    `spared` where the interval of the variant's F1 reaches the oracle's estimate; None below two
    recordings, and where there is no interval. `labels_tested` are the numbers of labelled images
    per light that were tried, `labels_that_win` is the smallest of them whose paired difference to
    the variant is above zero; None where there is none, and below two recordings.
    """
    name = name or study.chosen
    of, oracle = study.f1(name, group, colour), study.f1(ORACLE, group, colour)
    between = study.recordings(group) >= 2
    tested = {
        count: labelled
        for count in LABEL_COUNTS
        if (labelled := f"{count} labelled (per light)") in study.scores
    }
    winning = [
        count
        for count, labelled in tested.items()
        if between and study.difference(labelled, name, group, colour).low > 0
    ]
    return {
        "variant": name, "group": group, "colour": colour or "all", "f1": of.value,
        "low": of.low, "high": of.high, "oracle": oracle.value,
        "recordings": study.recordings(group), "unit": study.unit(group),
        "spared": bool(of.high >= oracle.value) if between and np.isfinite(of.high) else None,
        "labels_tested": list(tested), "labels_that_win": min(winning, default=None),
        "gap_closed": study.gap_closed(name, group),
    }  # fmt: skip

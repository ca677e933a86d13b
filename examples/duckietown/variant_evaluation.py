"""Evaluate variants of the threshold study image by image."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from examples.duckietown.fisheye_camera import FisheyeCamera
from examples.duckietown.lane_pose import lane_pose
from examples.duckietown.line_detector import (
    COLOURS,
    DETECTOR_SIZE,
    Thresholds,
    colour_masks,
    detect,
)
from examples.duckietown.line_scores import agreement, pixel_counts, segment_counts
from examples.duckietown.road_images import RoadImages
from examples.duckietown.road_renderer import Mask
from examples.duckietown.split import Rows, Split
from examples.duckietown.tuning import tune
from examples.duckietown.variants import (
    BASELINE,
    FitRequest,
    TranslatorCache,
    Variant,
    fit_sets,
    prepared,
    thresholds_of,
    translated,
)
from s2rtools.translation.image_set import Rgb
from s2rtools.translation.method import Translator

Floats = NDArray[np.float64]

CAMERA = FisheyeCamera().scaled(DETECTOR_SIZE[1] / FisheyeCamera().width)
"""The camera of rendered images, at the detector's resolution."""
_TIMED_IMAGES = 12
_TUNING_IMAGES = 120
"""Translated simulated images that ranges are tuned on, about."""
PLAUSIBLE_FACTOR = 4.0
"""Factor between the detected share of a colour and that of the simulation that is plausible."""
_COMMON_COLOURS = ("white", "yellow")
"""Colours that are in view on most roads; red marks stop lines alone."""
_DRAWS = 2
"""Draws of k labelled images per seed."""


@dataclass(slots=True, eq=False)
class Scores:
    """Scores of judged images: `pixels` (n, colours, 3) as in `pixel_counts`, `segments`
    (n, colours, 5) as in `segment_counts`, `pose` (n, 2) absolute errors of offset and heading, NaN
    where unknown; means over seeds. `by_seed` are the pixel counts summed per seed."""

    name: str
    label_free: bool
    pixels: Floats
    segments: Floats
    pose: Floats
    milliseconds: float = float("nan")
    by_seed: list[Floats] = field(default_factory=list)


def is_plausible(detected: float, expected: float) -> bool:
    """Whether two shares of pixels differ by at most a factor of `PLAUSIBLE_FACTOR`."""
    return expected / PLAUSIBLE_FACTOR <= detected <= expected * PLAUSIBLE_FACTOR


class Evaluation:
    """Evaluates variants on the judged images of a split, with translators from a cache."""

    def __init__(
        self,
        split: Split,
        sim: RoadImages,
        cache: TranslatorCache,
        tuned: Mapping[str, Thresholds],
        minutes: float | None = None,
        seeds: int = 1,
        pixels_only: bool = False,
    ) -> None:
        self.split, self.sim, self.cache, self.tuned = split, sim, cache, dict(tuned)
        self.minutes, self.seeds, self.pixels_only = minutes, seeds, pixels_only
        self._tuned_on: dict[Translator | None, Thresholds] = {}
        self._translated: dict[tuple[Translator | None, str], Rgb] = {}
        self._plausible: dict[str, bool] = {}

    @cached_property
    def _sim_labelled(self) -> RoadImages:
        rows = np.flatnonzero(self.sim.labelled)
        return self.sim.rows(rows[:: max(1, len(rows) // _TUNING_IMAGES)])

    def variant(self, variant: Variant) -> Scores:
        """Scores of a variant that uses no labels of real images.

        Raises RequestError where its method cannot be fitted.
        """
        learned = variant.source is not None and variant.source.learned
        runs = [self._variant(variant, seed) for seed in range(self.seeds if learned else 1)]
        return _averaged(variant.name, True, runs)

    def _variant(self, variant: Variant, seed: int) -> Scores:
        split = self.split
        pieces = []
        elapsed: list[float] = []
        for light in split.lights:
            used = Variant(BASELINE) if variant.guarded and self._is_plausible(light) else variant
            translator = self._translator(used, light, seed)
            rows = split.judged_in(light)
            images = split.images.images[rows]
            if used.direction == "sim2real":
                thresholds = self._translated_ranges(translator)
                seen, kind = images, "sim"
            else:
                thresholds, kind = thresholds_of(used.thresholds, self.tuned), used.thresholds
                if (translator, light) not in self._translated:
                    self._translated[translator, light] = translated(translator, images)
                seen = prepared(kind, self._translated[translator, light])
                elapsed += [] if self.pixels_only else _times(translator, kind, thresholds, images)
            pieces.append((rows, self._scores(rows, seen, thresholds)))
        result = _placed(variant.name, True, pieces, split)
        result.milliseconds = float(np.median(elapsed)) if elapsed else float("nan")
        return result

    def _translator(self, variant: Variant, light: str, seed: int) -> Translator | None:
        if variant.source is None:
            return None
        scope = "all" if variant.scope in ("image", "file") else variant.scope
        real = self.split.images.rows(self.split.fit_rows(light, scope))
        source, target = fit_sets(variant, real, self.sim)
        return self.cache.get(
            FitRequest(variant.source, variant.direction, seed, self.minutes), source, target
        )

    def plausible_lights(self) -> list[str]:
        """The lights in which `BASELINE` detects about as much white and yellow as there is in the
        simulation."""
        return [light for light in self.split.lights if self._is_plausible(light)]

    def _is_plausible(self, light: str) -> bool:
        """Whether `BASELINE` detects a plausible amount of each common colour in a light.

        `is_plausible` compares the detected share of the pixels of the images for fitting, which
        need no labels, with the true share in the simulation.
        """
        if light not in self._plausible:
            images = self._images(self.split.fit_rows(light, "light"))
            ranges = thresholds_of(BASELINE, self.tuned)
            seen = [colour_masks(image, ranges) for image in prepared(BASELINE, images)]
            labels = self.sim.masks[self.sim.labelled]
            self._plausible[light] = bool(seen) and all(
                is_plausible(
                    float(np.mean([masks[colour].astype(bool).mean() for masks in seen])),
                    float((labels == COLOURS.index(colour) + 1).mean()),
                )
                for colour in _COMMON_COLOURS
            )
        return self._plausible[light]

    def stability(self, variant: Variant, images_per_light: int = 24) -> float:
        """Agreement of two masks of the same images that should be equal, over all lights.

        The two come from fits on the two halves of the images for fitting of a light; where the
        statistics are those of each image, from the whole image and from its left and right half
        translated separately. A map that takes what is in view for light gives different masks. 1
        for a variant without a translator.
        """
        if variant.source is None:
            return 1.0
        counts = np.zeros((len(COLOURS), 3))
        for light in self.split.lights:
            rows = self.split.fit_rows(light, "light")
            if len(rows) < 2:
                continue
            images = self._images(rows[:: max(1, len(rows) // images_per_light)])
            if variant.source.of_image:
                translator = self._translator(variant, light, 0)
                middle = images.shape[2] // 2
                parts = images[:, :, :middle], images[:, :, middle:]
                sides = [translated(translator, np.ascontiguousarray(part)) for part in parts]
                pair = [translated(translator, images), np.concatenate(sides, axis=2)]
            else:
                request = FitRequest(variant.source, variant.direction, 0, self.minutes)
                pair = []
                for half in (rows[: len(rows) // 2], rows[len(rows) // 2 :]):
                    source, target = fit_sets(variant, self.split.images.rows(half), self.sim)
                    pair.append(translated(self.cache.get(request, source, target), images))
            seen = [prepared(variant.thresholds, each) for each in pair]
            ranges = thresholds_of(variant.thresholds, self.tuned)
            for first, second in zip(*seen, strict=True):
                one, other = colour_masks(first, ranges), colour_masks(second, ranges)
                for index, colour in enumerate(COLOURS):
                    truth = np.where(other[colour], index + 1, 0).astype(np.uint8)
                    counts[index] += pixel_counts(one, truth)[index]
        return agreement(counts)

    def _translated_ranges(self, translator: Translator | None) -> Thresholds:
        if translator not in self._tuned_on:
            labelled = self._sim_labelled
            images = translated(translator, labelled.images)
            self._tuned_on[translator] = tune(images, labelled.masks).thresholds
        return self._tuned_on[translator]

    def oracle(self, per_light: bool) -> Scores:
        """Ranges tuned on the judged images themselves, the best that thresholds can do."""
        name = "oracle per light" if per_light else "oracle, one setting"
        groups = [self.split.judged_in(light) for light in self.split.lights]
        groups = groups if per_light else [self.split.judged]
        pieces = [
            (rows, self._scores(rows, self._images(rows), self._ranges(rows))) for rows in groups
        ]
        return _placed(name, False, pieces, self.split)

    def labelled(self, count: int, per_light: bool) -> Scores | None:
        """Ranges tuned on `count` labelled real images, of the judged light or of all lights; None
        where there are too few. The images are drawn by seed, never from the judged half."""
        split = self.split
        name = f"{count} labelled ({'per light' if per_light else 'all lights'})"
        pools = [part.tuned if per_light else split.tuning_rows(part) for part in split.parts]
        if min(len(pool) for pool in pools) < count:
            return None
        runs = []
        for draw in range(_DRAWS * self.seeds):
            pieces = []
            for part, pool in zip(split.parts, pools, strict=True):
                rng = np.random.default_rng([draw, count, part.half, 53])
                ranges = self._ranges(np.sort(rng.choice(pool, count, replace=False)))
                images = self._images(part.judged)
                pieces.append((part.judged, self._scores(part.judged, images, ranges, True)))
            runs.append(_placed(name, False, pieces, split))
        return _averaged(name, False, runs)

    def _images(self, rows: Rows) -> Rgb:
        return self.split.images.images[rows]

    def _ranges(self, rows: Rows) -> Thresholds:
        """Ranges tuned on some images; colours without labels keep those of the simulation."""
        if not np.isin(self.split.images.masks[rows], range(1, len(COLOURS) + 1)).any():
            return self.tuned["sim"]
        tuning = tune(self._images(rows), self.split.images.masks[rows])
        found = {colour: tuned.range for colour, tuned in tuning.ranges.items()}
        return {**self.tuned["sim"], **found}

    def _scores(
        self, rows: Rows, images: Rgb, thresholds: Thresholds, pixels_only: bool = False
    ) -> Scores:
        masks: Mask = self.split.images.masks[rows]
        poses = self.split.images.poses[rows]
        count = len(rows)
        scores = _empty("", True, count)
        for index in range(count):
            if pixels_only or self.pixels_only:
                found_masks = colour_masks(images[index], thresholds)
                scores.pixels[index] = pixel_counts(found_masks, masks[index])
                continue
            found = detect(images[index], thresholds)
            scores.pixels[index] = pixel_counts(found.masks, masks[index])
            scores.segments[index] = segment_counts(found.segments, masks[index])
            if np.isfinite(poses[index]).all():
                pose = lane_pose(found.segments, CAMERA)
                if pose is not None:
                    scores.pose[index] = np.abs([pose.offset, pose.heading] - poses[index])
                else:
                    scores.pose[index] = np.inf
        return scores


def _times(
    translator: Translator | None, kind: str, thresholds: Thresholds, images: Rgb
) -> list[float]:
    """Milliseconds for single images through translator and detector."""
    elapsed = []
    for image in images[:_TIMED_IMAGES]:
        start = time.perf_counter()
        seen = prepared(kind, translated(translator, image[None]))
        detect(seen[0], thresholds)
        elapsed.append(1000 * (time.perf_counter() - start))
    return elapsed


def _placed(name: str, label_free: bool, pieces: list[tuple[Rows, Scores]], split: Split) -> Scores:
    """Scores of all judged rows from those of disjoint parts of them."""
    result = _empty(name, label_free, len(split.judged))
    for rows, scores in pieces:
        at = np.searchsorted(split.judged, rows)
        result.pixels[at], result.segments[at] = scores.pixels, scores.segments
        result.pose[at] = scores.pose
    return result


def _empty(name: str, label_free: bool, count: int) -> Scores:
    return Scores(
        name, label_free, np.zeros((count, len(COLOURS), 3)), np.zeros((count, len(COLOURS), 5)),
        np.full((count, 2), np.nan),
    )  # fmt: skip


def _averaged(name: str, label_free: bool, runs: list[Scores]) -> Scores:
    def mean(of: Callable[[Scores], Floats]) -> Floats:
        return np.asarray(np.mean([of(run) for run in runs], axis=0))

    times = [run.milliseconds for run in runs]
    return Scores(
        name, label_free, mean(lambda run: run.pixels), mean(lambda run: run.segments),
        mean(lambda run: run.pose), float(np.median(times)),
        [run.pixels.sum(axis=0) for run in runs],
    )  # fmt: skip

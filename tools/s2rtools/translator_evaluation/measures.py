"""The measures of a translator: name, unit, direction, and how each is computed and limited.

Reports, tables, the gate and the index read these tables. The limits of content, by which the gate
accepts a translator as an adjustment, lie between maps of colours, which keep all content, and
damage. They were chosen on 100 pairs of a synthetic world of rooms and checked on photographs of
rooms and of roads, 8 pairs of domains in all, with `identity`, `grayworld`, `reinhard`, `mkl`,
`histogram` and `fda`. Worst figure of these methods, and best figure of the damage that a limit is
for, over all domains:

| metric | methods | damage |
|---|---|---|
| edge_agreement | 0.81 | 0.24 constant, 0.52 shuffled |
| luminance_correlation | 0.86 | -0.98 inverted |
| region_correlation | 0.60 (`fda`) | -0.9 inverted |
| sharpness | 0.96 | 0.84 blur of 1 pixel, 0.76 of 1.5 pixels |
| diversity | 0.93 | 0.00 constant, one repeated image |
| matched, pairing_rank | 1.00, 1.00 | 0.05, 0.64 shuffled |
| invented_share | 0.05 | 0.6 an object of 6 pixels, 0.35 a patch of 8 pixels of another image |

Sizes are for images of 128 to 160 pixels. Not caught: a blur of 0.7 pixels, objects in fewer than
15 % of the images, and objects whose contrast is below a third of that of the image.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, SupportsFloat

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.intervals import Interval
from s2rtools.translation.image_set import Rgb, fit_size, resize
from s2rtools.translator_evaluation import content_metrics as metrics
from s2rtools.translator_evaluation.image_structure import Floats

INVENTED_AREA = 0.005
"""Share of an image from which an invented region counts."""
_VISIBLE_DEPTH_EDGES = 0.55
"""Smallest contrast of depth edges in the source with which those of a translated image are
compared."""
FEATURES = ("network", "colour")
"""Features of images: of a run's network, and of colours alone."""
CHANNELS = ("red", "green", "blue")
Content = dict[str, float]
"""Values of the measures of `CONTENT` by name; NaN where unknown."""
SHARPNESS_OF_TARGET = (0.8, 1.0)
"""Range to which the target's sharpness is clipped: a translator may blur as much as its target."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A measure as figures and tables name it; `title` heads its column, empty for none.

    Measures of content have `compute`. The gate refuses a translator on the wrong side of `limit`
    and says `reason`.
    """

    name: str
    title: str
    better: Literal["higher", "lower"]
    meaning: str
    unit: str = ""
    digits: int = 3
    compute: Callable[[Comparison], float] | None = None
    limit: float | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class MetricRow:
    """One figure of a report with its interval, which may be unknown.

    `reference` is translator, identity, repeated_image or target, `run` the run whose network was
    used, or None.
    """

    metric: str
    reference: str
    run: str | None
    interval: Interval
    unit: str


def figure(
    metric: str, interval: Interval | SupportsFloat, reference: str = "translator",
    run: str | None = None,
) -> MetricRow:  # fmt: skip
    """A figure of a measure, without an interval where a number is given."""
    known = interval if isinstance(interval, Interval) else Interval.unknown(float(interval))
    return MetricRow(metric, reference, run, known, MEASURES[metric].unit)


class Comparison:
    """Source images and translated ones of the same shape (N, H, W, 3), and what the measures of
    content need of them.

    `target` are images of the target domain, `groups` (N,) codes of recordings of neighbouring
    images and `edges` (N, H, W) the depth edges of the source; each may be None.
    """

    def __init__(
        self,
        source: Rgb,
        translated: Rgb,
        target: Rgb | None = None,
        groups: NDArray[np.integer[Any]] | None = None,
        edges: NDArray[np.bool_] | None = None,
    ) -> None:
        if source.shape != translated.shape:
            raise RequestError(
                f"translated images have shape {translated.shape}, the source {source.shape}"
            )
        if not len(source):
            raise RequestError("no images to compare; give at least one")
        self.source, self.translated, self.target = source, translated, target
        self.groups, self.edges = groups, edges
        size = fit_size(*source.shape[1:3])
        self.before, self.after = resize(source, size), resize(translated, size)

    @cached_property
    def correlation(self) -> Floats:
        return metrics.luminance_correlation(self.before, self.after)

    @cached_property
    def pairing(self) -> metrics.Pairing:
        return metrics.pairing(self.before, self.after)

    @cached_property
    def invented(self) -> Floats:
        return metrics.invented_regions(self.before, self.after)

    def target_sharpness(self) -> float:
        """Sharpness of the target's images over that of the source; 1 without a target."""
        if self.target is None:
            return 1.0
        both = (metrics.edge_sharpness(images) for images in (self.target, self.source))
        target, source = (_median(values) for values in both)
        return target / source

    def depth_edges_kept(self) -> float:
        """Mean contrast above chance of the translated images over that of the source."""
        if self.edges is None:
            return math.nan
        before = metrics.depth_edge_contrast(self.source, self.edges)
        after = metrics.depth_edge_contrast(self.translated, self.edges)
        shown = before >= _VISIBLE_DEPTH_EDGES
        if not shown.any():
            return math.nan
        return float((after[shown] - 0.5).mean() / (before[shown] - 0.5).mean())

    def flicker(self) -> float:
        return (
            math.nan
            if self.groups is None
            else metrics.flicker(self.before, self.after, self.groups)
        )


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan


CONTENT = (
    Measure(
        "edge_agreement", "edges", "higher", "mean cosine of edge strength and orientation",
        compute=lambda of: metrics.edge_agreement(of.before, of.after).mean(),
        limit=0.7, reason="edges are not those of the source",
    ),
    Measure(
        "luminance_correlation", "luminance", "higher", "mean correlation of the pixels",
        compute=lambda of: of.correlation.mean(),
        limit=0.3, reason="bright and dark do not correspond to the source",
    ),
    Measure(
        "inverted_share", "inverted", "lower", "share of images with a negative correlation",
        compute=lambda of: (of.correlation < 0).mean(),
        limit=0.1, reason="bright and dark are inverted",
    ),
    Measure(
        "region_correlation", "regions", "higher", "mean rank correlation of regions",
        compute=lambda of: metrics.region_correlation(of.before, of.after).mean(),
        limit=0.0, reason="bright and dark regions are inverted",
    ),
    Measure(
        "sharpness", "sharpness", "higher", "median of the sharpness relative to the source",
        compute=lambda of: _median(metrics.sharpness(of.source, of.translated)),
        limit=0.87, reason="images are blurred",
    ),
    Measure(
        "target_sharpness", "", "higher", "sharpness of the target's images relative to the source",
        compute=lambda of: of.target_sharpness(),
    ),
    Measure(
        "diversity", "diversity", "higher",
        "distances between translated images over those between source images",
        compute=lambda of: metrics.diversity(of.before, of.after),
        limit=0.5, reason="different images become alike",
    ),
    Measure(
        "matched", "own source", "higher",
        "share of translated images that resemble their own source most",
        compute=lambda of: of.pairing.matched,
        limit=0.5, reason="images do not resemble their own source most",
    ),
    Measure(
        "pairing_rank", "rank", "higher",
        "mean share of the other sources that resemble a translated image less",
        compute=lambda of: of.pairing.rank,
        limit=0.9, reason="images resemble other sources as much as their own",
    ),
    Measure(
        "invented_share", "invented", "lower",
        f"share of images with an invented region of at least {100 * INVENTED_AREA:g} %",
        compute=lambda of: (of.invented >= INVENTED_AREA).mean(),
        limit=0.15, reason="images show structure that the source does not have",
    ),
    Measure(
        "invented_area", "", "lower", "90th percentile of the largest invented region",
        compute=lambda of: np.quantile(of.invented, 0.9),
    ),
    Measure(
        "lost_area", "lost area", "lower", "90th percentile of the largest lost region",
        compute=lambda of: np.quantile(metrics.invented_regions(of.after, of.before), 0.9),
    ),
    Measure(
        "depth_edges_kept", "depth edges", "higher", "contrast of depth edges over the source's",
        compute=lambda of: of.depth_edges_kept(),
        limit=0.6, reason="outlines at steps of depth are lost",
    ),
    Measure(
        "flicker", "flicker", "lower",
        "additional change between neighbouring images, in units of contrast",
        compute=lambda of: of.flicker(),
    ),
)  # fmt: skip
"""What a translator keeps of its source, in the order of tables and of the gate's reasons."""

DISTANCES = (
    Measure("kid_network", "KID features", "lower", "kernel distance of a network's features"),
    Measure("kid_colour", "KID colour", "lower", "kernel distance of colours"),
    *(
        Measure(f"w1_{channel}", f"W1 {channel}", "lower", f"Wasserstein-1 distance of {channel}",
                "grey levels", 1)
        for channel in CHANNELS
    ),
)  # fmt: skip
COVERAGE = tuple(
    Measure(f"{name}_{features}", f"{name} ({features})", "higher", f"{meaning}, by {features}")
    for features in FEATURES
    for name, meaning in (
        ("precision", "share of translated images near the target's"),
        ("recall", "share of the target's images near translated ones"),
    )
)


def _error_measures(name: str, meaning: str) -> tuple[Measure, ...]:
    """An error in metres, its decrease, and the same at the level of one among several
    translators."""
    return (
        Measure(name, "", "lower", meaning, "m", 2),
        Measure(f"{name}_gain", "", "higher", f"decrease of the {meaning}", "m", 2),
        Measure(f"{name}_gain_tested", "", "higher",
                f"decrease of the {meaning}, one of several tests", "m", 2),
    )  # fmt: skip


TASK = (
    *_error_measures("error", "mean position error of a run's network on real images"),
    *_error_measures("sim_error", "mean position error of a run's network on sim images"),
    *_error_measures("trained_error", "mean real error after training on translated images")[:2],
    Measure("features_gain", "", "higher",
            "share by which the network's features come closer to the target's", "share"),
    Measure("downstream_score", "", "higher", "mean score of a model behind the translator"),
    Measure("downstream_gain", "", "higher", "increase of that score"),
    Measure("cost", "ms per image", "lower", "time of one image on one thread", "ms"),
)  # fmt: skip
MEASURES: Mapping[str, Measure] = {
    measure.name: measure for measure in (*CONTENT, *DISTANCES, *COVERAGE, *TASK)
}
"""All measures by name."""


def measure_content(
    source: Rgb,
    translated: Rgb,
    target: Rgb | None = None,
    groups: NDArray[np.integer[Any]] | None = None,
    edges: NDArray[np.bool_] | None = None,
) -> Content:
    """The measures of `CONTENT` of a `Comparison` of these images.

    Sharpness is measured at the size of the images, everything else at the size for fits. Raises
    RequestError if the shapes differ, and where there are no images.
    """
    compared = Comparison(source, translated, target, groups, edges)
    return {
        measure.name: float(measure.compute(compared)) for measure in CONTENT if measure.compute
    }


@dataclass(frozen=True, slots=True)
class Check:
    """One metric against its limit; `margin` is positive on the allowed side."""

    metric: str
    value: float
    limit: float
    passed: bool
    margin: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a translator is accepted; `reasons` say in words why not."""

    passed: bool
    reasons: tuple[str, ...]
    checks: tuple[Check, ...]


def judge(content: Content) -> Verdict:
    """Judge the content that a translator keeps. Measures that are unknown are not judged."""
    checks, reasons = [], []
    for measure in CONTENT:
        value = content[measure.name]
        if measure.limit is None or math.isnan(value):
            continue
        limit = measure.limit
        if measure.name == "sharpness" and not math.isnan(content["target_sharpness"]):
            low, high = SHARPNESS_OF_TARGET
            limit *= min(max(content["target_sharpness"], low), high)
        higher = measure.better == "higher"
        margin = value - limit if higher else limit - value
        checks.append(Check(measure.name, value, limit, margin >= 0, margin))
        if margin < 0:
            name = measure.name.replace("_", " ")
            sign = "<" if higher else ">"
            reasons.append(f"{measure.reason} ({name} {value:.2f} {sign} {limit:.2f})")
    return Verdict(not reasons, tuple(reasons), tuple(checks))

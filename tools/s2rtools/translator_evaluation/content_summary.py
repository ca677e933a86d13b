"""All metrics of the content that a translator keeps, over a set of images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.translation.image_set import Rgb, fit_size, resize
from s2rtools.translator_evaluation import content_metrics as metrics
from s2rtools.translator_evaluation.image_structure import Floats

INVENTED_AREA = 0.005
"""Share of an image from which an invented region counts."""
_VISIBLE_DEPTH_EDGES = 0.55
"""Smallest contrast of depth edges in the source with which those of a translated image are
compared."""


@dataclass(frozen=True, slots=True)
class ContentMetrics:
    """Metrics over `images` pairs of a source and a translated image; NaN where unknown.

    - edge_agreement: mean cosine of edge strength and orientation, 1 is equal.
    - luminance_correlation, region_correlation: mean correlation of pixels, and mean rank
      correlation of regions; inverted_share: share of images with a negative correlation of pixels.
    - sharpness: median of the sharpness relative to the source; target_sharpness: that of the
      target's images.
    - diversity: distances between translated images over those between source images.
    - matched, pairing_rank: how well sources are recognised, see `content_metrics.Pairing`.
    - invented_share: share of images with an invented region of at least `INVENTED_AREA`;
      invented_area, lost_area: 90th percentile of the largest region, a share of the image.
    - depth_edges_kept: contrast of depth edges relative to the source (0 none, 1 all).
    - flicker: additional change between neighbouring images, in units of contrast.
    """

    images: int
    edge_agreement: float
    luminance_correlation: float
    inverted_share: float
    region_correlation: float
    sharpness: float
    target_sharpness: float
    diversity: float
    matched: float
    pairing_rank: float
    invented_share: float
    invented_area: float
    lost_area: float
    depth_edges_kept: float
    flicker: float


def measure_content(
    source: Rgb,
    translated: Rgb,
    target: Rgb | None = None,
    groups: NDArray[np.integer[Any]] | None = None,
    edges: NDArray[np.bool_] | None = None,
) -> ContentMetrics:
    """Compare source images (N, H, W, 3) with translated ones of the same shape.

    Sharpness is measured at the size of the images, everything else at the size for fits. `target`
    are images of the target domain, `groups` (N,) codes of recordings of neighbouring images and
    `edges` (N, H, W) the depth edges of the source. Raises RequestError if the shapes differ.
    """
    if source.shape != translated.shape:
        raise RequestError(
            f"translated images have shape {translated.shape}, the source {source.shape}"
        )
    if not len(source):
        raise RequestError("no images to compare; give at least one")
    size = fit_size(*source.shape[1:3])
    before, after = resize(source, size), resize(translated, size)
    correlation = metrics.luminance_correlation(before, after)
    pairing = metrics.pairing(before, after)
    invented = metrics.invented_regions(before, after)
    lost = metrics.invented_regions(after, before)
    own_sharpness = 1.0
    if target is not None:
        own_sharpness = _median(metrics.edge_sharpness(target)) / _median(
            metrics.edge_sharpness(source)
        )
    return ContentMetrics(
        images=len(source),
        edge_agreement=float(metrics.edge_agreement(before, after).mean()),
        luminance_correlation=float(correlation.mean()),
        inverted_share=float((correlation < 0).mean()),
        region_correlation=float(metrics.region_correlation(before, after).mean()),
        sharpness=_median(metrics.sharpness(source, translated)),
        target_sharpness=own_sharpness,
        diversity=metrics.diversity(before, after),
        matched=pairing.matched,
        pairing_rank=pairing.rank,
        invented_share=float((invented >= INVENTED_AREA).mean()),
        invented_area=float(np.quantile(invented, 0.9)),
        lost_area=float(np.quantile(lost, 0.9)),
        depth_edges_kept=float("nan") if edges is None else _edges_kept(source, translated, edges),
        flicker=float("nan") if groups is None else metrics.flicker(before, after, groups),
    )


def _edges_kept(source: Rgb, translated: Rgb, edges: NDArray[np.bool_]) -> float:
    """Mean contrast above chance of the translated images over that of the source."""
    before = metrics.depth_edge_contrast(source, edges)
    after = metrics.depth_edge_contrast(translated, edges)
    shown = before >= _VISIBLE_DEPTH_EDGES
    if not shown.any():
        return float("nan")
    return float((after[shown] - 0.5).mean() / (before[shown] - 0.5).mean())


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")

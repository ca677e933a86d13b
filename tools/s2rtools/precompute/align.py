"""How far the real camera is from its declaration, found once per pair of domains and kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.geometry.alignment import Correction
from s2rstore.reader import Store
from s2rstore.records import SIDES, Domain, Intrinsics, Run
from s2rstore.writer import edit
from s2rtools.heatmaps.harmonise import Alignment, Images, View

MAX_FRAMES = 24
MAX_SIDE = 128
GRID_HEIGHT = np.round(np.arange(-0.16, 0.161, 0.02), 3)
GRID_ZOOM = np.round(np.arange(0.88, 1.141, 0.02), 3)


def alignment(store: Store, run: Run) -> Alignment | None:
    """The rigs of a run with the correction that the store keeps; None before it is known."""
    correction = store.correction(run.sim_domain, run.real_domain)
    if correction is None:
        return None
    frame = store.dataset.frame_height, store.dataset.frame_width
    sim, real = (store.domains[run.domain(side)] for side in SIDES)
    return Alignment(sim, real, frame, correction)


def ensure(root: Path, run: Run) -> bool:
    """Calibrate the run's pair of domains and publish it, where the store does not say it yet."""
    with s2rstore.open(root) as store:
        if store.correction(run.sim_domain, run.real_domain) is not None:
            return False
        sim, real = (store.domains[run.domain(side)] for side in SIDES)
        pairs, frame = _samples(store, sim, real)
        size = store.dataset.frame_height, store.dataset.frame_width
        found = calibrate(_shrunk(sim, frame, size), _shrunk(real, frame, size), frame, pairs)
    with edit(root) as draft:
        draft.note(
            f"alignment:{run.sim_domain}|{run.real_domain}",
            {"height": found.height, "zoom": found.zoom, "frames": len(pairs)},
        )
    return True


def _samples(
    store: Store, sim: Domain, real: Domain
) -> tuple[list[tuple[Images, Images]], tuple[int, int]]:
    """Pairs spread over the data set, at most `MAX_SIDE` on their longer side."""
    height, width = store.dataset.frame_height, store.dataset.frame_width
    share = min(1.0, MAX_SIDE / max(height, width))
    frame = max(8, round(height * share)), max(8, round(width * share))
    n = len(store.instances)
    rows = np.unique(np.linspace(0, n - 1, min(n, MAX_FRAMES)).astype(int))
    return [
        (_images(store, int(iid), sim, frame), _images(store, int(iid), real, frame))
        for iid in rows
    ], frame


def _images(store: Store, iid: int, domain: Domain, frame: tuple[int, int]) -> Images:
    shot = store.frame(iid, domain.domain)
    size = frame[1], frame[0]
    rgb = cv2.resize(shot.rgb, size, interpolation=cv2.INTER_AREA)
    depth = cv2.resize(shot.depth, size, interpolation=cv2.INTER_NEAREST)
    return np.asarray(rgb), depth, (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)


def _shrunk(domain: Domain, frame: tuple[int, int], size: tuple[int, int]) -> Domain:
    rows, cols = frame[0] / size[0], frame[1] / size[1]

    def scaled(lens: Intrinsics) -> Intrinsics:
        return replace(
            lens, fx=lens.fx * cols, cx=lens.cx * cols, fy=lens.fy * rows, cy=lens.cy * rows
        )

    return replace(domain, rgb=scaled(domain.rgb), depth=scaled(domain.depth))


def calibrate(
    sim: Domain, real: Domain, frame: tuple[int, int], pairs: list[tuple[Images, Images]]
) -> Correction:
    """The height and field of view of the real camera under which image gradients agree best.

    The score is the mean correlation of gradient magnitudes between the sim and the warped real
    image; the answer is the best of a grid of 2 cm by 2 %, none where that is not better.
    """
    best, chosen = -np.inf, Correction()
    for correction in _candidates(sim, real, frame, pairs):
        score = _agreement(Alignment(sim, real, frame, correction).sim_view, pairs)
        if score > best + 1e-9:
            best, chosen = score, correction
    return chosen


def _candidates(
    sim: Domain, real: Domain, frame: tuple[int, int], pairs: list[tuple[Images, Images]]
) -> list[Correction]:
    """No correction first; then zooms at their best height, and heights at the best zoom."""
    found = [Correction()]
    coarse = [Correction(float(h), float(z)) for h in GRID_HEIGHT[::2] for z in GRID_ZOOM[::2]]
    few = pairs[:: max(1, len(pairs) // 10)]
    scores = [_agreement(Alignment(sim, real, frame, c).sim_view, few) for c in coarse]
    around = coarse[int(np.argmax(scores))]
    found += [
        Correction(float(h), float(z))
        for h in GRID_HEIGHT if abs(h - around.height) < 0.03
        for z in GRID_ZOOM if abs(z - around.zoom) < 0.03
    ]  # fmt: skip
    return found


def _agreement(view: View, pairs: list[tuple[Images, Images]]) -> float:
    scores = []
    for pair in pairs:
        made = view.harmonised(*pair)
        if made.seen.mean() < 0.2:
            continue
        a, b = _gradient(made.sim), _gradient(made.real)
        inner = cv2.erode(made.seen.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        if inner.sum() < 100:
            continue
        with np.errstate(invalid="ignore"):
            found = np.corrcoef(a[inner], b[inner])[0, 1]
        if np.isfinite(found):
            scores.append(float(found))
    return float(np.mean(scores)) if scores else -np.inf


def _gradient(image: NDArray[Any]) -> NDArray[np.float32]:
    grey = cv2.cvtColor(image.astype(np.float32), cv2.COLOR_RGB2GRAY)
    grey = cv2.GaussianBlur(grey, (0, 0), 1.0)
    return np.asarray(
        np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    )

"""Check the declared conventions of headings, handedness, depth scale and order on depth images.

Points of several frames fall on the same cells of the floor where the conventions are right, and
are scattered where they are not. For every convention the points of the same depth pixels are put
on the floor, and the measure is the mutual information of a point's cell and its frame, nats:

    I = H(cell) - H(cell | frame)

H(cell) is the entropy of the histogram of all points. H(cell | frame), the mean entropy of those of
single frames, hardly depends on heading and handedness, but makes depth scales comparable: smaller
depths fill fewer cells in any case. The convention with the least I is the sharpest one.

Frames whose poses are those of other rows of their trajectory are found in the same way. Of these
orders only the sharpest one is compared with the conventions, and only if its I is clearly below
that of the declared order: neighbouring orders are about as sharp as each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import angles
from s2rtools.datasets.conventions.depth_frames import (
    DECLARED_ORDER,
    DepthFrames,
    DepthPoints,
    Order,
)

Floats = NDArray[np.float64]

CELL = 0.1
"""Edge of a cell of the floor, metres."""
MAX_FRAMES = 100
MIN_FRAMES = 20
"""Frames below which points overlap too little for a judgement."""
MIN_POINTS = 2000
_MARGIN_FRAMES = 10.0
"""Margin of I times the number of frames, nats."""
_TURNS = ("heading", "heading + 90 degrees", "heading + 180 degrees", "heading + 270 degrees")
_NEGATED = (
    "heading negated", "90 degrees - heading", "180 degrees - heading", "270 degrees - heading",
)  # fmt: skip
_MIRRORED = (
    "y negated", "x and y exchanged", "x negated", "x and y exchanged and negated",
)  # fmt: skip
_SWAPPED = (
    "y looks negated", "x and y look swapped", "x looks negated",
    "x and y look swapped and negated",
)  # fmt: skip
_MOST_ROWS = 30
"""Largest shift between the numbers of images and poses that is tried, in rows."""
_ORDER_STEP = 3
"""Of the sampled depth pixels, every third one in each axis serves to search the order."""
ORDERS = (
    Order(is_reversed=True),
    *(Order(sign * rows) for rows in range(1, _MOST_ROWS + 1) for sign in (1, -1)),
)
"""The orders of poses that are searched apart from the declared one."""
SCALES = (0.1, 0.2, 0.5, 2.0, 5.0, 10.0)

Verdict = Literal["as declared", "doubtful", "not decided"]


@dataclass(frozen=True, slots=True)
class Convention:
    """A change of the declared conventions.

    Headings h become `sign` h + `quarters` 90 degrees, `flipped` exchanges left and right in the
    images, and depth is multiplied by `scale`. `order` tells which pose an image has.
    """

    sign: int = 1
    quarters: int = 0
    flipped: bool = False
    scale: float = 1.0
    order: Order = DECLARED_ORDER

    def on_floor(self, points: DepthPoints) -> tuple[Floats, Floats]:
        """x and y of depth points under this convention, (m,) each, metres."""
        poses = points.source.orders.get(self.order, points.source.poses).copy()
        poses[:, 2] = self.sign * poses[:, 2] + self.quarters * angles.TURN / 4
        return points.on_floor(poses, self.flipped, self.scale)

    @property
    def finding(self) -> str:
        """How data looks for which this convention, and not the declared one, is right."""
        if self.order != DECLARED_ORDER:
            return self.order.finding
        if self.scale > 1.0:
            return f"depth looks {self.scale:g} times too small"
        if self.scale < 1.0:
            return f"depth looks {1 / self.scale:g} times too large"
        if self.flipped:
            return _SWAPPED[self.quarters] if self.sign < 0 else "images look mirrored"
        if self.sign < 0:
            return "headings look counted in the other direction"
        return f"headings look turned by {90 * self.quarters} degrees"

    def __str__(self) -> str:
        if self.order != DECLARED_ORDER:
            return str(self.order)
        if self.scale != 1.0:
            return f"depth x {self.scale:g}"
        if self.flipped and self.sign < 0:
            return _MIRRORED[self.quarters]
        if self.flipped:
            turned = f"{_TURNS[self.quarters]} and " if self.quarters else ""
            return f"{turned}y_down inverted"
        if self.sign < 0:
            return _NEGATED[self.quarters]
        return _TURNS[self.quarters] if self.quarters else "as declared"


DECLARED = Convention()
CONVENTIONS = (
    *(Convention(s, q, f) for f in (False, True) for s in (1, -1) for q in range(4)),
    *(Convention(scale=scale) for scale in SCALES),
)
"""All conventions that are compared.

Negated headings together with an inverted handedness equal mirrored positions: see `_MIRRORED`.
"""


@dataclass(frozen=True, slots=True)
class Sharpness:
    """How one convention puts the points on the floor: H(cell) and I, nats."""

    entropy: float
    information: float


@dataclass(frozen=True, slots=True, eq=False)
class ConventionCheck:
    """The result for one domain; without enough frames or points `sharpness` is empty."""

    domain: str
    frames: int
    points: int
    sharpness: Mapping[Convention, Sharpness]

    @property
    def margin(self) -> float:
        """Least lead that decides, nats: 0.1 for 100 frames, more for fewer."""
        return _MARGIN_FRAMES / max(self.frames, 1)

    @property
    def ranking(self) -> list[Convention]:
        """All conventions, the sharpest one first."""
        return sorted(self.sharpness, key=lambda each: self.sharpness[each].information)

    @property
    def best_other(self) -> Convention:
        """The sharpest convention apart from the declared one."""
        return next(each for each in self.ranking if each != DECLARED)

    @property
    def lead(self) -> float:
        """By how much I of the sharpest convention is below that of the next one, nats."""
        first, second = (self.sharpness[each].information for each in self.ranking[:2])
        return second - first

    @property
    def verdict(self) -> Verdict:
        """The sharpest convention decides if it leads all others by the margin."""
        if not self.sharpness or self.lead < self.margin:
            return "not decided"
        return "as declared" if self.ranking[0] == DECLARED else "doubtful"

    @property
    def text(self) -> str:
        """The result in words."""
        if not self.sharpness:
            return f"{self.domain} not decided ({self.frames} frames, {self.points} points)"
        finding = f": {self.best_other.finding}" if self.verdict == "doubtful" else ""
        return f"{self.domain} {self.verdict}{finding} ({self.figures})"

    @property
    def figures(self) -> str:
        """The measure of the declared convention and of the sharpest other one, nats."""
        declared, best = self.sharpness[DECLARED], self.sharpness[self.best_other]
        return (
            f"{declared.information:.2f} nats as declared, "
            f"{best.information:.2f} with {self.best_other}"
        )

    def facts(self) -> dict[str, Any]:
        """The result as provenance."""
        return {
            "verdict": self.verdict,
            "frames": self.frames,
            "points": self.points,
            "margin": round(self.margin, 4),
            "conventions": {
                str(each): {
                    "entropy": round(found.entropy, 4),
                    "information": round(found.information, 4),
                }
                for each, found in self.sharpness.items()
            },
        }


def sharpness(points: DepthPoints, convention: Convention) -> Sharpness:
    """H(cell) and I of the points of frames under a convention."""
    x, y = (np.floor(part / CELL).astype(np.int64) for part in convention.on_floor(points))
    x, y = x - x.min(), y - y.min()
    cells = x * (y.max() + 1) + y
    entropy = _entropy(cells)
    in_frames = _entropy(points.frames * (cells.max() + 1) + cells)
    given = in_frames - _entropy(points.frames)
    return Sharpness(entropy, entropy - given)


def check_conventions(frames: DepthFrames) -> ConventionCheck:
    """Compare the conventions on some frames of a domain."""
    points = DepthPoints(frames)
    enough = len(frames.poses) >= MIN_FRAMES and len(points) >= MIN_POINTS
    found = {each: sharpness(points, each) for each in CONVENTIONS} if enough else {}
    check = ConventionCheck(frames.domain.domain, len(frames.poses), len(points), found)
    if found and frames.orders:
        few = DepthPoints(frames, _ORDER_STEP)
        orders = [Convention(order=order) for order in frames.orders]
        best = min(orders, key=lambda each: sharpness(few, each).information)
        in_order = sharpness(points, best)
        if in_order.information <= found[DECLARED].information - check.margin:
            found[best] = in_order
    return check


def _entropy(values: NDArray[np.int64]) -> float:
    """Entropy of the frequencies of values, nats."""
    counts = np.unique(values, return_counts=True)[1]
    shares = counts / counts.sum()
    return float(-(shares * np.log(shares)).sum())

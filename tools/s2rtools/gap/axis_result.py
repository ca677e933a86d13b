"""Evidence, interface and result of an axis of the gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import LEVEL, Interval
from s2rstore.intervals.verdict import Bounds
from s2rstore.reader import Store
from s2rtools.gap import defaults
from s2rtools.motion_logs import Drive

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GapSettings:
    """Settings of all axes.

    `level` is that of the intervals, and of a FAIL unless `fail_level` is given; `seed` is that of
    random splits. `pca` is the number of principal
    components whose divergence the visual axis reports.
    """

    level: float = LEVEL
    fail_level: float | None = None
    seed: int = defaults.SEED
    pca: int = 3


@dataclass(frozen=True, slots=True)
class Evidence:
    """Data on which the gap is measured: a run of a store with the selected iids (n,), and drives.

    `features` is a file that describes an image network; None: the embedding of the run.
    `anchor_run` is the run whose sim images are the bad state; None: derived from the adjustments.
    """

    store: Store
    run: str
    iids: NDArray[np.int64]
    expression: str = "all"
    drives: Sequence[Drive] = ()
    features: Path | None = None
    anchor_run: str | None = None


@dataclass(frozen=True, slots=True)
class AxisResult:
    """Measurement of one axis.

    `value` is the measure m and `floor` its value without a gap, in the unit of the axis, from `n`
    samples (images, instances or windows). `bounds` gives the interval of m at a level. Two
    measurements are comparable if their `fingerprint` is equal; it holds n only where m depends on
    it. `details` are further figures as JSON data,
    `notes` are sentences for the reader (warnings, omissions).
    """

    axis: str
    value: float
    floor: float
    n: int
    bounds: Bounds
    fingerprint: Mapping[str, str | int | float]
    details: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Anchor:
    """m in the declared bad state with its interval, and the name of the state."""

    interval: Interval
    state: str


class Axis:
    """Interface of an axis of the gap."""

    name: ClassVar[str]
    unit: ClassVar[str]
    measure_is: ClassVar[str]
    """Short description of m."""
    floor_is: ClassVar[str]
    """Short description of the floor, which is 0 for every axis, for different reasons."""
    reason: ClassVar[str]
    """Reasons for this m, this floor and this anchor."""

    def missing(self, evidence: Evidence) -> str | None:
        """The reason why the evidence does not cover the axis; None where it does."""
        return None

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        """Raises InconclusiveError where there are too few samples, RequestError for bad ones."""
        raise NotImplementedError

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        """The declared bad state on the same evidence. Raises RequestError if it is missing."""
        raise NotImplementedError

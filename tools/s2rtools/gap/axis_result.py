"""What an axis of the gap measures, and what it hands to the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics.bootstrap import BootstrapSettings
from s2rstore.reader import Store
from s2rtools.motion_logs import Drive

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GapSettings(BootstrapSettings):
    """Bootstrap settings of all axes.

    `pca` is the number of principal components whose divergence the visual axis reports.
    """

    pca: int = 3


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the gap is measured on: a run of a store with the selected iids (n,), and drives.

    `features` is a file that describes an image network; None means the run's own embedding.
    `anchor_run` is the run whose sim images are the bad state; None finds it by the adjustments.
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
    """One axis measured.

    `value` is m and `floor` what m would be without a gap, both in the axis' unit, from `n`
    samples (images, instances or windows). `replicates` and `floor_replicates` (R,) are drawn
    together: row r of both comes from one resample. `fingerprint` is all that must agree for two
    measurements to be comparable, n only where m depends on it. `details` are further figures as
    plain JSON data, `notes` are sentences for the reader (warnings, what was refused).
    """

    axis: str
    value: float
    floor: float
    n: int
    replicates: Floats
    floor_replicates: Floats
    fingerprint: Mapping[str, str | int | float]
    details: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Anchor:
    """m in a declared bad state: its value, replicates (R,), and which state that is."""

    value: float
    replicates: Floats
    state: str


class Axis:
    """One axis of the gap: a file of its own and a line in `axes`."""

    name: ClassVar[str]
    unit: ClassVar[str]
    measure_is: ClassVar[str]
    """What m is, in a few words."""
    floor_is: ClassVar[str]
    """What the floor is, in a few words; all four are 0, for a reason of their own each."""
    reason: ClassVar[str]
    """Why this m, this floor and this anchor."""

    def missing(self, evidence: Evidence) -> str | None:
        """Why this evidence says nothing about the axis; None where it does."""
        return None

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        """Raises InconclusiveError where there are too few samples, RequestError for bad ones."""
        raise NotImplementedError

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        """The declared bad state on the same evidence; raises RequestError where there is none."""
        raise NotImplementedError

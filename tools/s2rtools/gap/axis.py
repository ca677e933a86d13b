"""Evidence, settings, interface and result of an axis of the gap."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.intervals import LEVEL, Interval
from s2rstore.intervals.verdict import Bounds
from s2rstore.reader import Store
from s2rtools.gap.axes import SEED
from s2rtools.gap.delay.time_delay import DelayEstimates
from s2rtools.motion_logs import Drive

Floats = NDArray[np.float64]
Details = Mapping[str, Any]
"""Further figures of an axis as JSON data."""


@dataclass(frozen=True, slots=True)
class GapSettings:
    """Settings of all axes.

    `level` is that of the intervals, and of a FAIL unless `fail_level` is given; `seed` is that of
    random splits.
    """

    level: float = LEVEL
    fail_level: float | None = None
    seed: int = SEED


@dataclass(frozen=True, slots=True)
class Evidence:
    """Data on which the gap is measured: a run of a store with the selected iids (n,), and drives.

    `features` is a file that describes an image network; None: the embedding of the run.
    `anchor_run` is the run whose sim images are the bad state; None: derived from the adjustments.
    `delays` estimates the time delay of each drive once for all axes.
    """

    store: Store
    run: str
    iids: NDArray[np.int64]
    expression: str = "all"
    drives: Sequence[Drive] = ()
    features: Path | None = None
    anchor_run: str | None = None
    delays: DelayEstimates = field(default_factory=DelayEstimates)


@dataclass(frozen=True, slots=True)
class AxisResult:
    """Measurement of one axis.

    `value` is the measure m and `floor` its value without a gap, in the unit of the axis, from `n`
    samples (images, instances or windows). `bounds` gives the interval of m at a level. Two
    measurements are comparable if their `fingerprint` is equal; it holds n only where m depends on
    it. `notes` are sentences for the reader (warnings, omissions).
    """

    value: float
    floor: float
    n: int
    bounds: Bounds
    fingerprint: Mapping[str, str | int | float]
    details: Details = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Anchor:
    """m in the declared bad state with its interval, and the name of the state."""

    interval: Interval
    state: str


Parser = Callable[[str], Any]
"""Parses the text of an option. Raises RequestError that says what was expected."""


class Axis:
    """The computation of an axis; `axes.AXES` holds its name, unit and descriptions.

    The constructor takes the options of the axis by their names.
    """

    parsers: ClassVar[Mapping[str, Parser]] = {}
    """Parsers of the axis' options by name."""

    def missing(self, evidence: Evidence) -> str | None:
        """The reason why the evidence does not cover the axis; None where it does."""
        return None

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        """Raises InconclusiveError where there are too few samples, RequestError for bad ones."""
        raise NotImplementedError

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        """The declared bad state on the same evidence. Raises RequestError if it is missing."""
        raise NotImplementedError

    def compare_runs(self, evidence: Evidence, settings: GapSettings) -> dict[str, Any] | None:
        """A comparison of all runs of the store as JSON data; None where the axis has none."""
        return None

    def describe(self, details: Details) -> Iterator[str]:
        """Yield lines and tables of the details of a result."""
        yield from ()


@dataclass(frozen=True, slots=True)
class Measurement:
    """Results by axis; `absent` and `inconclusive` hold the reasons for axes without a result."""

    measured: Mapping[str, AxisResult]
    absent: Mapping[str, str]
    inconclusive: Mapping[str, str]


def measure(evidence: Evidence, settings: GapSettings, axes: Mapping[str, Axis]) -> Measurement:
    """Measure each axis. Raises RequestError for invalid evidence."""
    measured: dict[str, AxisResult] = {}
    absent: dict[str, str] = {}
    inconclusive: dict[str, str] = {}
    for name, axis in axes.items():
        reason = axis.missing(evidence)
        if reason is not None:
            absent[name] = reason
            continue
        try:
            measured[name] = axis.measure(evidence, settings)
        except InconclusiveError as error:
            inconclusive[name] = str(error)
    return Measurement(measured, absent, inconclusive)


def no_drives(evidence: Evidence) -> str | None:
    """The reason why axes of motion cannot be measured; None where there are drives."""
    if evidence.drives:
        return None
    return "no drives: name a folder of real and simulated logs (--drives)"


def with_interval(row: Mapping[str, Any], name: str, digits: int = 3) -> str:
    """A value of JSON data with its interval, or the reason why it has none."""
    return Interval.from_columns(row, name).with_bounds(f"{{:.{digits}f}}".format)


def number(text: str, expected: str, most: float | None = None) -> float:
    """A finite number; with `most`, above 0 and up to `most`. Raises RequestError."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or (most is not None and not 0 < value <= most):
        raise RequestError(f"expected {expected}")
    return value


def whole_number(low: int, high: int) -> Parser:
    """A parser of whole numbers from `low` to `high`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if not low <= value <= high:
            raise RequestError(f"must be {low} to {high}")
        return value

    return parse


def one_of(known: Collection[str]) -> Parser:
    """A parser of one of several words."""

    def parse(text: str) -> str:
        if text not in known:
            raise RequestError(f"expected one of {', '.join(known)}")
        return text

    return parse


MAX_REACH = 60.0
"""Longest delay that can be searched, s."""


def reach(text: str) -> float:
    """The longest delay that is searched, s."""
    return number(text, f"seconds up to {MAX_REACH:g} such as 0.5", MAX_REACH)

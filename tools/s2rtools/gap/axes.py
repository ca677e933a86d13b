"""The registry of the axes of the gap, their options, and defaults; imports no numerical library.

A new axis is one module with a class of `axis.Axis`, and one record here; a package adds one by an
entry point of the group `s2r.metrics`, an `AxisRecord`. Command, report, tables, gate and nightly
read the records.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rstore.plugins import Registry, instance_of

if TYPE_CHECKING:
    from s2rtools.gap.axis import Axis

THRESHOLD = 15.0
"""Largest G that passes."""
MARGIN = 0.05
"""Metres by which the mean real error may grow since the golden run, as an upper bound."""
SEED, MAX_SEED = 1, 2**31 - 1
ODOMETRY = "odometry"
"""Value of `--drives` for the odometry of the data set, compared with its ground truth."""


@dataclass(frozen=True, slots=True)
class AxisRecord:
    """What command, report and gate need to know of an axis.

    `measure` and `floor` describe m and its value without a gap, which is 0 for every axis, for
    different reasons. `options` are names with a default or example and a description; they are
    written as `flag` NAME=VALUE, or as --NAME VALUE where `flag` is None. `implementation` is
    MODULE:CLASS.
    """

    name: str
    unit: str
    measure: str
    floor: str
    implementation: str
    options: Mapping[str, str] = field(default_factory=dict)
    flag: str | None = None

    def load(self) -> type[Axis]:
        """The class of the axis."""
        module, _, name = self.implementation.partition(":")
        loaded: type[Axis] = getattr(importlib.import_module(module), name)
        return loaded


MOTION = "--dynamics"
"""The flag of the options of all axes that compare drives."""

_RECORDS = (
    AxisRecord(
        name="visual",
        unit="KID",
        measure="kernel distance (KID) of sim and real images in the feature space",
        floor="0 by construction: the same distance between the real images of two halves of the "
        "instances, averaged over all splits into halves",
        implementation="s2rtools.gap.visual.visual_axis:VisualAxis",
        options={"pca": "principal components of the features (default 3)"},
    ),
    AxisRecord(
        name="task",
        unit="m",
        measure="mean paired gap: real error - sim error",
        floor="0: without a gap the errors of a pair do not differ",
        implementation="s2rtools.gap.task.task_axis:TaskAxis",
    ),
    AxisRecord(
        name="dynamics",
        unit="share of the scale",
        measure="NRMSE of position over time windows, above the noise floor, time delay removed",
        floor="0: the noise floor (repeated real drives, or noise of the real poses) is subtracted "
        "in m",
        implementation="s2rtools.gap.dynamics.dynamics_axis:DynamicsAxis",
        options={
            "horizons": "0.5,1,2 (s)",
            "nrmse": "travel|extent|deviation",
            "align": "rigid+reflection+scale for APE and RPE",
            "rpe": "1s or 25 (poses)",
            "noise": "0.002,0.003 (m, rad) of the real poses",
            "reach": "1 (s), the longest delay that is searched",
        },
        flag=MOTION,
    ),
    AxisRecord(
        name="delay",
        unit="control periods",
        measure="absolute time delay of reality behind the simulator, in periods of the controller",
        floor="0: the share of noise in the size of a delay is subtracted in m",
        implementation="s2rtools.gap.delay.delay_axis:DelayAxis",
        options={
            "reach": "1 (s), the longest delay that is searched",
            "bad": "period|untuned, the bad state of the delay",
            "period": "0.05 (s) of the controller",
        },
        flag=MOTION,
    ),
)
AXES = Registry[AxisRecord](
    "metric", {record.name: record for record in _RECORDS}, instance_of(AxisRecord)
)


def options_of(flag: str | None) -> dict[str, str]:
    """The options that are written with a flag, with their descriptions; None: as --NAME VALUE."""
    records = [record for record in AXES.values() if record.flag == flag]
    return {name: text for record in records for name, text in record.options.items()}


def flags() -> list[str]:
    """The flags that take NAME=VALUE."""
    return list(dict.fromkeys(record.flag for record in AXES.values() if record.flag))


def configured(options: Mapping[str, str]) -> dict[str, Axis]:
    """All axes by name with their `options`, texts by name. Raises RequestError."""
    return {
        record.name: record.load()(**{
            name: _parsed(record, name, options[name]) for name in record.options if name in options
        })
        for record in AXES.values()
    }  # fmt: skip


def _parsed(record: AxisRecord, name: str, text: str) -> object:
    try:
        return record.load().parsers[name](text)
    except RequestError as error:
        written = f"{record.flag} {name}={text}" if record.flag else f"--{name} {text}"
        raise RequestError(f"{written}: {error}") from error

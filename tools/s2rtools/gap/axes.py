"""The axes of the gap; a new axis is one module and one line here."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from s2rtools.gap.axis_result import Axis

AXES: dict[str, str] = {
    "visual": "visual.visual_axis:VisualAxis",
    "task": "task.task_axis:TaskAxis",
    "dynamics": "dynamics.dynamics_axis:DynamicsAxis",
    "delay": "delay.delay_axis:DelayAxis",
}
"""Module and class of each axis; imported when the axis is measured."""


def axis(name: str) -> Axis:
    """The axis with default options."""
    module, _, kind = AXES[name].partition(":")
    instance: Axis = getattr(importlib.import_module(f"s2rtools.gap.{module}"), kind)()
    return instance

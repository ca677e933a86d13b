"""The axes of the gap. Adding one is a file and a line here."""

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
"""Where each is; imported when it is measured."""


def axis(name: str) -> Axis:
    """The axis of a name in `AXES`."""
    module, _, kind = AXES[name].partition(":")
    found: Axis = getattr(importlib.import_module(f"s2rtools.gap.{module}"), kind)()
    return found

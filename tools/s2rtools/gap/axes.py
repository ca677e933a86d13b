"""The axes of the gap. Adding one is a file and a line here."""

from __future__ import annotations

from s2rtools.gap.contract import Axis
from s2rtools.gap.dynamics.axis import Dynamics
from s2rtools.gap.dynamics.lateness import Delay
from s2rtools.gap.task.axis import Task
from s2rtools.gap.visual.axis import Visual

AXES: dict[str, Axis] = {axis.name: axis for axis in (Visual(), Task(), Dynamics(), Delay())}

"""A differential-drive robot on a plane, from its equations of motion."""

from __future__ import annotations

import numpy as np

from s2rtools.sysid.simulators import simulator
from s2rtools.sysid.simulators.simulator import LATENCY, Floats, Parameter, Replays, Values

STEP = 0.005
"""Duration of an integration step, s."""

COMMON = (
    Parameter("mass", "kg", 2.0, 60.0, 12.0, "of the robot", searched=True),
    Parameter("friction", "N", 0.05, 40.0, 3.0, "that does not grow with speed", searched=True),
    Parameter("damping", "N s/m", 0.2, 80.0, 8.0, "resistance that grows with speed",
              searched=True),
    Parameter(LATENCY, "s", 0.0, 0.3, 0.02, "from a command to its first effect", "linear",
              searched=True),
    Parameter("gain", "N m", 0.05, 20.0, 1.0, "torque of one unit of effort"),
    Parameter("gyration", "1", 0.1, 4.0, 0.8, "inertia over mass and half track squared",
              structural=True),
    Parameter("wheels", "1", -0.2, 0.2, 0.0, "right over left wheel radius, less 1", "linear",
              structural=True),
    Parameter("wheel_radius", "m", 0.01, 0.5, 0.05, "of both wheels, nominal"),
    Parameter("track", "m", 0.05, 2.0, 0.3, "between the wheels"),
)  # fmt: skip

DRAG = Parameter("drag", "N s2/m2", 0.0, 20.0, 1.0, "resistance that grows with speed squared",
                 "linear", searched=True)  # fmt: skip


class Planar(simulator.Simulator):
    """The planar simulator; `planar_kernel` has the equations."""

    name = "planar"
    parameters = (*COMMON[:3], DRAG, *COMMON[3:])
    torques = ("left_torque", "right_torque")
    efforts = ("left_effort", "right_effort")
    shared = ("mass", "gain", "friction", "damping", "drag")

    def __init__(self, step: float = STEP) -> None:
        self.step = step

    def replay(self, values: Values, replays: Replays, states: Floats) -> Floats:
        from s2rtools.sysid.simulators.planar_kernel import replay_all

        half, radius, unequal = values["track"] / 2, values["wheel_radius"], values["wheels"]
        inertia = values["gyration"] * values["mass"] * half * half
        left, right = radius * (1 - unequal / 2), radius * (1 + unequal / 2)
        body = np.array([
            values["mass"], inertia, half, left, right, radius,
            values["friction"], values["damping"], values["drag"], values[LATENCY],
        ])  # fmt: skip
        out = np.empty((len(replays.times), 5))
        torque = values["gain"] * replays.values
        replay_all(body, self.step, replays.times, replays.first, replays.drive,
                   replays.command_time, torque, replays.held,
                   np.ascontiguousarray(states, np.float64), out)  # fmt: skip
        return out

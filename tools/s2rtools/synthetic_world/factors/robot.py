"""Factors `latency` and `wheels`: differences of the robot, visible in its drives only."""

from __future__ import annotations

from s2rtools.synthetic_world.factors.factor import Factor


class Latency(Factor):
    """Actuators that follow commands with a delay, set by the generator of the drives."""

    name = "latency"
    description = "actuators that answer late"
    moves_robot = True


class Wheels(Factor):
    """One wheel larger than the other, which no simulator parameter can express."""

    name = "wheels"
    description = "wheels of unequal radius"
    moves_robot = True

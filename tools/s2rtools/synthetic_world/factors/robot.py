"""What the real robot does otherwise; the drives of a world show it, images do not."""

from __future__ import annotations

from s2rtools.synthetic_world.factors.factor import Factor


class Latency(Factor):
    """Wheels that obey later than they are told; the drives' maker knows by how much."""

    name = "latency"
    description = "actuators that answer late"
    moves_robot = True


class Wheels(Factor):
    """One wheel larger than the other, which no parameter of the simulator can be."""

    name = "wheels"
    description = "wheels of unequal radius"
    moves_robot = True

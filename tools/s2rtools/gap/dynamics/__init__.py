"""How far a simulated drive is from the real one of the same commands, and how much later."""

from s2rtools.gap.delay.delay_axis import DelayAxis
from s2rtools.gap.dynamics.dynamics_axis import DynamicsAxis

__all__ = ["DelayAxis", "DynamicsAxis"]

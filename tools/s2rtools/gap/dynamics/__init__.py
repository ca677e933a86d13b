"""The dynamics axis: errors of simulated drives against real drives with the same commands."""

from s2rtools.gap.dynamics.dynamics_axis import DynamicsAxis

__all__ = ["DynamicsAxis"]

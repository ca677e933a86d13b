"""How far a simulated drive is from the real one of the same commands, and how much later."""

from s2rtools.gap.dynamics.axis import Dynamics
from s2rtools.gap.dynamics.lateness import Delay

__all__ = ["Delay", "Dynamics"]

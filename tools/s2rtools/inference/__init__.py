"""Run a network on this machine: batch norm folding, precision, backends.

Registry: `calibration.BACKENDS` maps a backend's name to a `Backend` class.
"""

from s2rtools.inference.backend import Backend, ForwardOutput
from s2rtools.inference.calibration import (
    MeasuredBackend,
    choose_backend,
    open_backend,
    open_float32,
)

__all__ = [
    "Backend",
    "ForwardOutput",
    "MeasuredBackend",
    "choose_backend",
    "open_backend",
    "open_float32",
]

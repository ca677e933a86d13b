"""Run a network on this machine: batch norm folding, precision, backends.

Registry: `backend.BACKENDS` maps a backend's name to a `Backend` class.
"""

from s2rtools.inference.backend import Backend, ForwardOutput, choose_backend, open_backend

__all__ = ["Backend", "ForwardOutput", "choose_backend", "open_backend"]

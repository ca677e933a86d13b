"""Running a network on the machine at hand: folding, precision, backend."""

from s2rtools.inference.backend import Backend, ForwardOutput, choose_backend, open_backend

__all__ = ["Backend", "ForwardOutput", "choose_backend", "open_backend"]

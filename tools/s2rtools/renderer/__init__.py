"""Renderers are programs: the protocol that they speak, and the processes that s2r starts.

`serve` makes a renderer of a Python function. The modules `world` and `mesh` are programs that ship
with s2r; `RendererWorkers` runs any program.
"""

from __future__ import annotations

from s2rtools.renderer.protocol import CameraPose, Hello, Parameter
from s2rtools.renderer.serving import serve

__all__ = ["CameraPose", "Hello", "Parameter", "serve"]

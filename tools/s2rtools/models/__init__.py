"""Pose networks, their weights files and the conventions of their outputs.

Registry: `ARCHITECTURES` maps an architecture's name to a `PoseNetwork` class. To add an
architecture, write one module with a subclass of `PoseNetwork` and add it to `ARCHITECTURES`. A
package adds one by an entry point of the group `s2r.architectures`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.plugins import Registry
from s2rtools.models.pose_network import PoseNetwork
from s2rtools.models.posest import PosEst
from s2rtools.models.resposenet import ResPoseNet


def _check(name: str, part: Any, others: Mapping[str, Any]) -> type[PoseNetwork]:
    is_network = isinstance(part, type) and issubclass(part, PoseNetwork)
    if not is_network or part.architecture != name:
        raise RequestError(f"is no PoseNetwork whose architecture is {name!r}")
    return part


ARCHITECTURES = Registry[type[PoseNetwork]](
    "architecture", {network.architecture: network for network in (PosEst, ResPoseNet)}, _check
)


def build_network(architecture: str) -> PoseNetwork:
    """An untrained network of an architecture. Raises RequestError for unknown names."""
    return ARCHITECTURES.find(architecture)()

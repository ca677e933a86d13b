"""Pose networks, their weights files and the conventions of their outputs.

Registry: `ARCHITECTURES` maps an architecture's name to a `PoseNetwork` class. To add an
architecture, write one module with a subclass of `PoseNetwork` and add one line to
`ARCHITECTURES`.
"""

from __future__ import annotations

from s2rstore.errors import RequestError
from s2rtools.models.pose_network import PoseNetwork
from s2rtools.models.posest import PosEst
from s2rtools.models.resposenet import ResPoseNet

ARCHITECTURES: dict[str, type[PoseNetwork]] = {
    network.architecture: network for network in (PosEst, ResPoseNet)
}


def build_network(architecture: str) -> PoseNetwork:
    """An untrained network of an architecture. Raises RequestError for unknown names."""
    if architecture not in ARCHITECTURES:
        raise RequestError(f"architecture {architecture!r}: one of {', '.join(ARCHITECTURES)}")
    return ARCHITECTURES[architecture]()

"""Pose networks: `ARCHITECTURES` lists those that can be built by name."""

from __future__ import annotations

from s2rstore.errors import RequestError
from s2rtools.models.pose_network import PoseNetwork
from s2rtools.models.posest import PosEst
from s2rtools.models.resposenet import ResPoseNet

ARCHITECTURES: dict[str, type[PoseNetwork]] = {
    network.architecture: network for network in (PosEst, ResPoseNet)
}


def build_network(architecture: str) -> PoseNetwork:
    """An untrained network; RequestError for unknown names."""
    if architecture not in ARCHITECTURES:
        raise RequestError(f"architecture {architecture!r}: one of {', '.join(ARCHITECTURES)}")
    return ARCHITECTURES[architecture]()

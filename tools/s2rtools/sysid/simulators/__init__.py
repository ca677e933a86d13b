"""Simulators whose parameters can be identified."""

from __future__ import annotations

from collections.abc import Callable

from s2rtools.sysid.simulators.planar import Planar
from s2rtools.sysid.simulators.simulator import Parameter, Replays, Simulator


def _mujoco() -> Simulator:
    from s2rtools.sysid.simulators.mujoco import MuJoCo

    return MuJoCo()


SIMULATORS: dict[str, Callable[[], Simulator]] = {"planar": Planar, "mujoco": _mujoco}

__all__ = ["SIMULATORS", "Parameter", "Planar", "Replays", "Simulator"]

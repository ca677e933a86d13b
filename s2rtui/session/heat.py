"""Which heatmaps a run has, and one instance's heat laid on the map."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.alignment import Surface
from s2rstore.geometry.grid import MapGrid, Projector, Ray
from s2rstore.reader import Store
from s2rstore.records import Domain, Run, Side
from s2rstore.sides import run_domain, run_frame
from s2rtui.session.state import HeatChoice

SIGNED = ("activation", "occlusion")
_ORDER: dict[Side, tuple[Side, Side]] = {"sim": ("sim", "real"), "real": ("real", "sim")}
_NOT_HEAT = ("prediction", "embedding", "pca", "umap")
_PLANES = {"activation": ("loss", "x", "y", "heading")}
_UNITS = {"m degrees": "m", "m m rad loss": ""}
_PLANE_UNITS = {"x": "m", "y": "m", "heading": "rad", "loss": "loss"}


def choices(store: Store, run: str) -> list[tuple[str, str | None]]:
    """Kinds and modes of a run's heatmaps, in the order that keys walk through them."""
    found: list[tuple[str, str | None]] = []
    for record in store.arrays(run):
        if record.kind in _NOT_HEAT or record.kind.startswith(("map:", "frames:")):
            continue
        for mode in _PLANES.get(record.kind, (record.mode,)):
            if (record.kind, mode) not in found:
                found.append((record.kind, mode))
    return found


def unit(store: Store, run: str, heat: HeatChoice) -> str:
    """The unit of the shown values."""
    if heat.kind in _PLANES:
        return _PLANE_UNITS[heat.mode or "loss"]
    record = next((r for r in store.arrays(run) if r.kind == heat.kind), None)
    return _UNITS.get(record.unit, record.unit) if record else ""


def run_range(store: Store, run: str, heat: HeatChoice) -> tuple[float, float] | None:
    """The run's own 1st .. 99th percentile of a heatmap kind; None where it was not noted."""
    noted = json.loads(store.provenance(f"run:{run}").get("heat ranges", "{}"))
    found = noted.get(":".join(part for part in (heat.kind, heat.mode) if part))
    return (float(found[0]), float(found[1])) if found else None


def ray_of(heat: HeatChoice) -> Ray:
    """The camera whose pixels a heatmap lies on."""
    return "depth" if heat.mode == "depth" else "rgb"


def run_grid(
    store: Store, run: str, heat: HeatChoice, aggregate: str = "mean"
) -> NDArray[np.float32] | None:
    """A published grid of a run, NaN where nothing fell; None where it was not computed."""
    try:
        grid = store.map_grid(run, heat.kind, heat.side, heat.mode, aggregate)
    except RequestError:
        return None
    return np.where(grid > 0, grid, np.nan) if aggregate == "count" else grid


def instance_grid(store: Store, run: str, heat: HeatChoice, iid: int) -> NDArray[np.float32]:
    """The mean grid of one instance's heatmap, (rows, cols), NaN where nothing fell."""
    dataset = store.dataset
    frame = dataset.frame_height, dataset.frame_width
    domain, depth = _surface(store, store.run(run), heat, iid, frame)
    grid = MapGrid(dataset.bounds)
    projector = _projector(domain.domain, _Held(domain), frame, dataset.y_down)
    values = store.heatmap(run, heat.kind, heat.side, iid, heat.mode)
    truth = store.instances
    pose = np.array([[truth.x[iid], truth.y[iid], truth.heading[iid]]])
    grid.add(*projector.project(values[None], depth, pose, ray_of(heat), grid))
    return np.asarray(grid.aggregates()[0])


def _surface(
    store: Store, run: Run, heat: HeatChoice, iid: int, frame: tuple[int, int]
) -> tuple[Domain, NDArray[Any]]:
    """The rig that carries the heat, and raw depth (1, H, W) where it lies, as in precompute."""
    own, other = (run_domain(store, run, side) for side in _ORDER[heat.side])
    noted = json.loads(store.provenance(f"run:{run.run}").get("surfaces", "{}"))
    correction = store.correction(run.sim_domain, run.real_domain)
    surface = Surface(own, other, frame, heat.side == "real", correction, noted.get(heat.kind))
    near, far = _ORDER[heat.side]
    away = run_frame(store, run, far, iid).depth[None] if surface.needs_other else None
    return surface.domain, surface.depth(run_frame(store, run, near, iid).depth[None], away)


class _Held:
    """A domain as a cache key by its content."""

    def __init__(self, domain: Domain) -> None:
        self.domain = domain

    def __hash__(self) -> int:
        return hash(self.domain.domain)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Held) and other.domain == self.domain


@lru_cache(maxsize=8)
def _projector(name: str, held: _Held, frame: tuple[int, int], y_down: bool) -> Projector:
    return Projector(held.domain, frame, y_down)

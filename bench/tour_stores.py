"""Stores of many short tours through the default building under several conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.measured_stores import QUIET
from s2rstore.index.transaction import edit
from s2rstore.records import Side
from s2rtools.datasets.importers import synthetic_world as importer
from s2rtools.datasets.scan import InstanceRecord, ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import insert_run
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
from s2rtools.synthetic_world.factors import FACTORS
from s2rtools.synthetic_world.renderer import Camera, RenderedViews, SceneRenderer
from s2rtools.synthetic_world.routes import Poses, drive_along
from s2rtools.synthetic_world.world import World
from s2rtools.training import pretrained

MODEL = "vanilla"
FRAME = 128
ROOMS = 5
"""Rooms of a tour; consecutive views look alike, as in a recording."""
_SPARE = 8
_VIEWS = 1_000_000
"""Noise numbers reserved for each domain."""

Severities = Mapping[str, float]
Looks = Mapping[str, tuple[Severities, Severities]]
"""Factors of the sim and of the real side, by the name of the run."""


def tours_store(path: Path, seeds: Sequence[int], count: int, looks: Looks, noise: int = 0) -> None:
    """A store of one trajectory of `count` views a seed, and a computed run of each look.

    No model was trained on these poses; trajectory k belongs to seeds[k]. Another `noise` gives
    other photographs of the same places.
    """
    scan = importer.scan(Path(), ScanOptions(frame=(FRAME, FRAME), world={"count": 2}))
    sides = {_domain(name, side): looks[name][side == "real"]
             for name in looks for side in ("sim", "real")}  # fmt: skip
    kinds = {_domain(name, side): scan.domains[side] for name in looks for side in ("sim", "real")}
    scan.domains = {name: replace(kind, domain=name) for name, kind in kinds.items()}
    domain_looks = _open_looks(sides)
    world = World(pretrained.WORLD_SEED)
    scan.trajectories = {
        f"tour-{number:05d}": _records(
            tour(world, seed, count), domain_looks, noise, number * count
        )
        for number, seed in enumerate(seeds)
    }
    scan.recorded_at, scan.drives = {}, None
    build(scan, path, "bench", strict=True, progress=lambda views: None)
    pretrained.add_pretrained_models(path)
    with edit(path) as draft:
        for name in looks:
            insert_run(draft, name, MODEL, (_domain(name, "sim"), _domain(name, "real")))
    precompute(path, QUIET, list(looks), PrecomputeOptions(kinds=()))


def tour(world: World, seed: int, count: int) -> Poses:
    """Poses (count, 3) of a drive through a few random rooms."""
    rng = np.random.default_rng([seed, 91])
    rooms = [room.area for room in world.plan.rooms]
    while True:
        chosen = [rooms[int(k)] for k in rng.permutation(len(rooms))[:ROOMS]]
        stops = [
            (float(rng.uniform(a.x0 + 0.5, a.x1 - 0.5)), float(rng.uniform(a.y0 + 0.5, a.y1 - 0.5)))
            for a in chosen
        ]
        line = world.floor.route(stops)
        if len(line) < count:  # the first stop lies behind furniture
            continue
        poses = drive_along(line, rng, count + _SPARE, world.has_content)
        if len(poses) >= count:
            return poses[:count]


class _CachedRenderer:
    """Caches the most recent views of another renderer."""

    def __init__(self, renderer: SceneRenderer) -> None:
        self._one = lru_cache(256)(
            lambda pose, camera, samples: renderer.render(
                np.frombuffer(pose).reshape(1, 3), camera, *samples
            )
        )

    def render(self, poses: Poses, camera: Camera, *samples: int) -> RenderedViews:
        parts = [self._one(pose.tobytes(), camera, samples) for pose in poses]
        return RenderedViews(*(np.concatenate([getattr(part, name) for part in parts])
                       for name in ("rgb", "depth", "identity")))  # fmt: skip


class _Look(WorldData):
    """A side that shares its noise-free views with other sides."""

    def __init__(self, recipe: WorldRecipe, rendered: Any) -> None:
        super().__init__(recipe)
        self._rendered = rendered

    def renderer(self, side: Side) -> Any:
        return self._rendered


def _open_looks(sides: Mapping[str, Severities]) -> dict[str, _Look]:
    """The renderer of each domain; sides that differ only in their sensors share rendered views."""
    world, scenes, looks = World(pretrained.WORLD_SEED), {}, {}
    for name, factors in sides.items():
        shaping = {f: v for f, v in factors.items() if FACTORS[f].shapes_scene}
        key = tuple(sorted(shaping.items()))
        if key not in scenes:
            scenes[key] = _CachedRenderer(world.renderer(shaping))
        all_factors = {**dict.fromkeys(FACTORS, 0.0), **factors}
        recipe = WorldRecipe(pretrained.WORLD_SEED, count=2, frame=FRAME, factors=all_factors)
        looks[name] = _Look(recipe, scenes[key])
    return looks


def _records(
    poses: NDArray[np.float64], looks: Mapping[str, _Look], noise: int, first: int
) -> list[InstanceRecord]:
    """Records of the poses; every view of a store has different sensor noise."""
    return [
        InstanceRecord(
            x=float(pose[0]), y=float(pose[1]), heading=float(pose[2]),
            sources={
                name: importer.RenderedFrameSource(look, pose, place * _VIEWS + first + row, "real")
                for place, (name, look) in enumerate(looks.items(), noise * len(looks))
            },
        )
        for row, pose in enumerate(poses)
    ]  # fmt: skip


def _domain(run: str, side: str) -> str:
    return f"{run}-{side}"

"""One trial of data collection: choose poses, fine-tune a model on their real images, judge it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from bench.support.head_training import embeddings, trained_head_poses
from s2rstore.geometry.rooms import room_codes
from s2rstore.records import SPLITS, Room, Side
from s2rtools.common.weights_file import read_state
from s2rtools.data_collection.candidates import CandidatePoses, world_candidates
from s2rtools.data_collection.expected_reduction import Evidence, LocalValues, Method, local_values
from s2rtools.data_collection.plan import CollectionRequest, choose_poses
from s2rtools.models import build_network
from s2rtools.models.load_model import load_state
from s2rtools.models.pose_network import LoadedModel
from s2rtools.precompute.tasks.outliers import neighbour_distance, outlier_scores
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
from s2rtools.synthetic_world.routes import drive_along
from s2rtools.synthetic_world.world import DEPTH_SCALE
from s2rtools.training.evaluation import pose_errors, predict
from s2rtools.training.pretrained import FOLDER, WORLD_SEED, model_description
from s2rtools.training.training_frames import CopiedFrames, TrainingFrames
from s2rtools.training.training_loop import Budget, train

Poses = NDArray[np.float64]
Floats = NDArray[np.float64]
EVIDENCE = 120
"""Instances of the drive whose errors are known, about as many as the demo store has."""
HELD_OUT = 300
SIM_IMAGES = 120
"""Sim images that are mixed with the real ones, as recipe `finetune` does."""
_TRAIN, _TEST = SPLITS.index("train"), SPLITS.index("test")
_BATCH = 64


def pretrained_model(name: str) -> LoadedModel:
    """A pretrained model, without a store."""
    architecture = model_description(name)["architecture"]
    path = FOLDER / f"{name}.safetensors"
    network = build_network(architecture)
    load_state(network, read_state(path, path.read_bytes()), str(path))
    network.eval().requires_grad_(False)
    return LoadedModel(name, architecture, network, network.convention, name)


@dataclass(frozen=True, slots=True)
class TrialSettings:
    """Fine-tuning of all methods of a trial, in the building of a random seed.

    `layers`: all by recipe `finetune` for a number of steps, or those after the embedding alone.
    """

    model: str = "dataaug"
    steps: int = 60
    held_out: int = HELD_OUT
    layers: Literal["all", "head"] = "all"
    building: int = WORLD_SEED


class Trial:
    """A seed: a drive as evidence, held-out poses, sim images; the same for all methods."""

    def __init__(self, seed: int, settings: TrialSettings) -> None:
        self.seed, self.settings = seed, settings
        self.data = WorldData(WorldRecipe(seed=settings.building))
        self.world = self.data.world
        self.model = pretrained_model(settings.model)

    @cached_property
    def candidates(self) -> CandidatePoses:
        return world_candidates(self.world, self.rooms, self.room_names)

    @cached_property
    def rooms(self) -> list[Room]:
        plan = self.world.plan.rooms
        return [
            Room(room.name, k, room.area.x0, room.area.y0, room.area.x1, room.area.y1)
            for k, room in enumerate(plan)
        ]

    @property
    def room_names(self) -> list[str]:
        return [room.room for room in self.rooms]

    @cached_property
    def drive(self) -> Poses:
        """A drive through random stops in all rooms."""
        rng = np.random.default_rng([self.seed, 101])
        areas = [self.world.plan.rooms[k].area for k in rng.permutation(len(self.rooms)).tolist()]
        stops = [
            (rng.uniform(a.x0 + 0.5, a.x1 - 0.5), rng.uniform(a.y0 + 0.5, a.y1 - 0.5))
            for a in areas
        ]
        line = self.world.floor.route(stops)
        return drive_along(line, rng, EVIDENCE, self.world.has_content)

    @cached_property
    def held_out(self) -> Poses:
        rng = np.random.default_rng([self.seed, 102])
        return self.world.floor.samples(rng, self.settings.held_out, self.world.has_content)

    @cached_property
    def sim_poses(self) -> Poses:
        rng = np.random.default_rng([self.seed, 103])
        return self.world.floor.samples(rng, SIM_IMAGES, self.world.has_content)

    def frames(self, side: Side, poses: Poses, noise: int) -> CopiedFrames:
        """Images of poses (n, 3); `noise` begins the seeds of their noise."""
        rgb, depth = [], []
        for start in range(0, len(poses), _BATCH):
            part = poses[start : start + _BATCH]
            numbers = noise + start + np.arange(len(part)) + 10_000_000 * (self.seed + 1)
            views = self.data.views(side, part, numbers)
            rgb.append(views.rgb)
            depth.append(self.data.raw_depth(views))
        return CopiedFrames(
            side, np.concatenate(rgb), np.concatenate(depth), DEPTH_SCALE, self.model.contract
        )

    @cached_property
    def held_out_frames(self) -> CopiedFrames:
        return self.frames("real", self.held_out, 0)

    @cached_property
    def held_out_embeddings(self) -> Tensor:
        return embeddings(self.model, self.held_out_frames)

    @cached_property
    def sim_frames(self) -> CopiedFrames:
        return self.frames("sim", self.sim_poses, 10_000)

    @cached_property
    def evidence(self) -> Evidence:
        """What a store of the drive would show about the model."""
        rows = np.arange(len(self.drive))
        errors, novelty = {}, np.ones(len(rows))
        sides: tuple[Side, Side] = ("sim", "real")
        for side in sides:
            frames = self.frames(side, self.drive, 20_000)
            poses = predict(self.model.network, self.model.convention, frames, rows)
            errors[side], _ = pose_errors(poses, self.drive)
            if side == "real":
                novelty = self._novelty(frames)
        return Evidence(
            iids=rows,
            poses=self.drive,
            rooms=self._room_codes(self.drive),
            trajectories=np.zeros(len(rows), dtype=np.int32),
            real_error=errors["real"],
            sim_error=errors["sim"],
            novelty=np.where(np.isfinite(novelty), novelty, 1.0),
            harm=None,
            trained_poses=np.empty((0, 3)),
            trained_rooms=np.empty(0, dtype=np.int32),
        )

    def _novelty(self, frames: CopiedFrames) -> Floats:
        """Outlier scores (n,) of the embeddings."""
        points, rows = embeddings(self.model, frames).numpy(), np.arange(len(frames.rgb))
        return outlier_scores(neighbour_distance(points, rows, points, rows))

    def _room_codes(self, poses: Poses) -> NDArray[np.int32]:
        return room_codes(poses[:, 0], poses[:, 1], self.rooms, self.room_names)

    @cached_property
    def values(self) -> LocalValues:
        return local_values(self.candidates, self.evidence, CollectionRequest("").similarity)

    def choose(self, method: Method, budget: int) -> Poses:
        """The poses (n, 3) that a method chooses, in the order of their choice."""
        request = CollectionRequest(self.settings.model, budget, method, self.seed)
        batch = choose_poses(self.candidates, self.evidence, self.values, request)
        return self.candidates.poses(batch.cells)

    def errors_before(self) -> Floats:
        """Errors (n,) in metres of the pretrained model at the held-out poses."""
        rows = np.arange(len(self.held_out))
        frames = self.held_out_frames
        poses = predict(self.model.network, self.model.convention, frames, rows)
        return pose_errors(poses, self.held_out)[0]

    def errors_after(self, chosen: Poses) -> Floats:
        """The same after fine-tuning on real images at the chosen poses (n, 3)."""
        real = self.frames("real", chosen, 30_000)
        if self.settings.layers == "head":
            sources = [(self.sim_frames, self.sim_poses), (real, chosen)]
            poses = trained_head_poses(self.model, sources, self.held_out_embeddings, self.seed)
            return pose_errors(poses, self.held_out)[0]
        count = max(len(chosen), SIM_IMAGES)
        splits = {}
        for name, frames in (("sim", self.sim_frames), ("real", real)):
            codes = np.full(count, _TEST, dtype=np.int8)
            codes[: len(frames.rgb)] = _TRAIN
            splits[name] = codes
        domains = {"sim": _padded(self.sim_frames, count), "real": _padded(real, count)}
        own = {"sim": _rows(self.sim_poses, count), "real": _rows(chosen, count)}
        trajectory = np.zeros(count, dtype=np.int32)
        result = train(
            TrainingFrames(dict(domains), own["real"], trajectory, own),
            "finetune",
            budget=Budget(steps=self.settings.steps),
            seed=self.seed,
            start=self.model,
            start_splits=splits,
        )
        rows = np.arange(len(self.held_out))
        poses = predict(result.network, result.convention, self.held_out_frames, rows)
        return pose_errors(poses, self.held_out)[0]


def _rows(values: NDArray[np.generic], count: int) -> NDArray:
    """The first rows, continued by repeating them."""
    return values[np.arange(count) % len(values)]


def _padded(frames: CopiedFrames, count: int) -> CopiedFrames:
    """Frames of `count` rows: those beyond the images repeat them, and train nothing."""
    rgb, depth = _rows(frames.rgb, count), _rows(frames.depth, count)
    return CopiedFrames(frames.kind, rgb, depth, frames.depth_scale, frames.contract)

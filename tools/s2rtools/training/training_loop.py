"""Train a pose network for a number of minutes or of steps."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from s2rstore.errors import RequestError
from s2rstore.metrics.pose_metrics import LOSS_GAMMA
from s2rtools.common.checkpoint import FitProgress, FitState, read_checkpoint, write_checkpoint
from s2rtools.common.torch_device import device
from s2rtools.models import build_network
from s2rtools.models.conventions import OutputConvention
from s2rtools.models.pose_network import LoadedModel, PoseNetwork
from s2rtools.training import splits as split_rules
from s2rtools.training.evaluation import Splits, evaluate_splits, pose_errors, predict
from s2rtools.training.recipes import Augmentation, TrainingRecipe, find_recipe
from s2rtools.training.training_frames import TrainingFrames

BATCH = 32
HEADING_LEVER = 4.0
"""Metres ahead of the robot of the point whose displacement measures the heading error."""

WEIGHT_DECAY = 0.02
WARM_UP = 0.05
CHECKPOINT_SECONDS = 10.0

ReportProgress = Callable[[float, float, float], None]
"""Called with the finished fraction, the last loss and the remaining seconds."""


@dataclass(frozen=True, slots=True)
class Budget:
    """End of a training: after `steps` batches if given (reproducible), else after `minutes`."""

    minutes: float = 2.0
    steps: int | None = None

    def fraction(self, progress: FitProgress) -> float:
        if self.steps is not None:
            return min(1.0, progress.step / max(1, self.steps))
        return min(1.0, progress.seconds / max(1e-9, self.minutes * 60))


@dataclass(frozen=True, slots=True, eq=False)
class TrainingResult:
    """A trained network in evaluation mode with its splits, history and metrics.

    `splits` holds codes into `records.SPLITS` for each domain; `history` has a row per epoch;
    `metrics` are those of `evaluation.evaluate_splits`.
    """

    network: PoseNetwork
    convention: OutputConvention
    splits: Splits
    history: list[dict[str, float]]
    metrics: dict[str, float]
    provenance: dict[str, str]


def train(
    frames: TrainingFrames,
    recipe: str,
    *,
    architecture: str = "resposenet",
    budget: Budget | None = None,
    seed: int = 0,
    start: LoadedModel | None = None,
    start_splits: Splits | None = None,
    report: ReportProgress | None = None,
    checkpoint: Path | None = None,
    adjustments: Sequence[Mapping[str, Any]] = (),
    selected: NDArray[np.bool_] | None = None,
) -> TrainingResult:
    """Train by a recipe, on a GPU where there is one.

    On one device, the same seed and number of steps give the same weights; a GPU adds in another
    order than a processor. The trained network is on the processor.

    `start` is the model to train further, with its splits. With `checkpoint` the state is saved
    there every few seconds and a later call continues from it. `adjustments` of the
    `frames` are among the facts of the checkpoint. Where `selected` (N,) is given, the other
    instances are in no split of this training. Raises RequestError for unknown names, a missing
    start and too few images.
    """
    chosen = find_recipe(recipe)
    if chosen.needs_start and start is None:
        raise RequestError(f"recipe {recipe}: needs a trained model to begin with; name its run")
    splits = _splits(frames, chosen, start_splits, selected)
    trainer = _Trainer(frames, chosen, splits, architecture, budget or Budget(), seed, start,
                       adjustments)  # fmt: skip
    trainer.run(report or (lambda fraction, loss, seconds: None), checkpoint)
    network = trainer.network.eval().requires_grad_(False)
    metrics = evaluate_splits(network, trainer.convention, frames, splits)
    network.to("cpu")
    history = trainer.progress.history
    provenance = {**trainer.provenance(), "figures": json.dumps(metrics)}
    return TrainingResult(network, trainer.convention, splits, history, metrics, provenance)


def _splits(
    frames: TrainingFrames,
    recipe: TrainingRecipe,
    start_splits: Splits | None,
    selected: NDArray[np.bool_] | None = None,
) -> Splits:
    """Split of the instances of each domain, including what the start model was trained on.

    What the start model has learned from never becomes a test. Instances that were appended after
    its training are split by the rules, those that are not `selected` (N,) are unseen.
    """
    splits: Splits = {}
    for name, domain in frames.domains.items():
        imaged = frames.imaged.get(name, np.ones(len(frames), dtype=np.bool_))
        others = imaged[:0]
        if selected is not None and domain.kind in recipe.learns_from:
            imaged, others = imaged & selected, imaged & ~selected
        rows, before = frames.trajectory[imaged], (start_splits or {}).get(name)
        before = None if before is None else before[imaged]
        if domain.kind not in recipe.learns_from:
            unseen = np.full(len(rows), split_rules.UNSEEN, dtype=np.int8)
            codes = unseen if before is None else before
        elif domain.kind == "real":
            codes = split_rules.with_earlier(split_rules.split_by_recording(rows), before)
        elif before is not None and (before == split_rules.TRAIN).any():
            appended = before == split_rules.UNSEEN
            codes = np.where(appended, split_rules.split_by_blocks(rows), before)
        else:
            codes = split_rules.split_by_blocks(rows)
        splits[name] = np.full(len(frames), split_rules.NO_SPLIT, dtype=np.int8)
        splits[name][imaged] = codes
        if others.any():
            unseen = np.full(len(frames), split_rules.UNSEEN, dtype=np.int8)
            splits[name][others] = (start_splits or {}).get(name, unseen)[others]
    return splits


class _Trainer:
    """One training: network, optimizer, batches and progress."""

    def __init__(
        self,
        frames: TrainingFrames,
        recipe: TrainingRecipe,
        splits: Splits,
        architecture: str,
        budget: Budget,
        seed: int,
        start: LoadedModel | None,
        adjustments: Sequence[Mapping[str, Any]],
    ) -> None:
        self.adjustments = json.dumps(list(adjustments), sort_keys=True) if adjustments else None
        self.frames, self.recipe, self.budget, self.seed = frames, recipe, budget, seed
        self.domains = [
            name for kind in recipe.learns_from for name, domain in frames.domains.items()
            if domain.kind == kind
        ]  # fmt: skip
        self.rows = _rows(splits, self.domains, split_rules.TRAIN)
        self.held_out = _rows(splits, self.domains, split_rules.VALIDATION)
        if len(self.rows) < 2:
            kinds = " and ".join(recipe.learns_from)
            raise RequestError(f"recipe {recipe.name}: no {kinds} images to train on")
        self.start = start
        self.device = device()
        self.network, self.convention = self._network(architecture)
        self.size = (start.contract if start else self.network.contract).size
        self.optimizer = torch.optim.AdamW(
            self.network.parameters(), recipe.learning_rate, weight_decay=WEIGHT_DECAY
        )
        self._state = FitState(self.network, {"all": self.optimizer})
        self.augment: Augmentation = recipe.augmentation(self.size, seed)
        self.progress = FitProgress()

    def _network(self, architecture: str) -> tuple[PoseNetwork, OutputConvention]:
        with torch.random.fork_rng():
            torch.manual_seed(self.seed)
            network = build_network(self.start.architecture if self.start else architecture)
        if self.start is not None:
            network.load_state_dict(self.start.network.state_dict())
            return network, self.start.convention
        places = self._poses_of(self.rows)[:, :2]
        x, y = places.mean(axis=0)
        network.centre_output((float(x), float(y)), float(max(places.std(axis=0).max(), 0.1)))
        return network, network.convention

    def run(self, report: ReportProgress, checkpoint: Path | None) -> None:
        """Train until the budget is used up; an interrupt saves a checkpoint."""
        self.network.to(self.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        if checkpoint is not None and checkpoint.exists():
            self.progress = read_checkpoint(checkpoint, self._state, self.facts())
        self.network.train().requires_grad_(True)
        saved = time.monotonic()
        try:
            while (done := self.budget.fraction(self.progress)) < 1:
                began = time.monotonic()
                loss = self._step(done)
                self.progress.seconds += time.monotonic() - began
                done = self.budget.fraction(self.progress)
                report(done, loss, self.progress.seconds / max(done, 1e-9) * (1 - done))
                if time.monotonic() - saved > CHECKPOINT_SECONDS:
                    self._save(checkpoint)
                    saved = time.monotonic()
        finally:
            self._save(checkpoint)

    def _step(self, done: float) -> float:
        per_epoch = max(1, len(self.rows) // BATCH)
        epoch, position = divmod(self.progress.step, per_epoch)
        order = np.random.default_rng([self.seed, epoch]).permutation(len(self.rows))
        batch = self.rows[order[position * BATCH : (position + 1) * BATCH]]
        generator = torch.Generator().manual_seed(self.seed * 1_000_003 + self.progress.step)
        x = self.augment(self._inputs(batch), generator)
        pose = self._poses_of(batch)
        truth = np.column_stack([pose[:, :2], np.cos(pose[:, 2]), np.sin(pose[:, 2])])
        for group in self.optimizer.param_groups:
            group["lr"] = self.recipe.learning_rate * learning_rate_share(done)
        raw = self.network(x.to(self.device).contiguous(memory_format=torch.channels_last))
        target = torch.from_numpy(truth.astype(np.float32)).to(self.device)
        loss = training_loss(self.convention.components(raw), target)
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        self.progress.add({"loss": loss.item()})
        if position + 1 == per_epoch:
            self._end_epoch(epoch + 1)
        return loss.item()

    def _poses_of(self, rows: NDArray[np.intp]) -> NDArray[np.float64]:
        """The true poses (B, 3) of (domain number, iid) rows."""
        poses = np.empty((len(rows), 3))
        for number, name in enumerate(self.domains):
            chosen = rows[:, 0] == number
            poses[chosen] = self.frames.truth(name)[rows[chosen, 1]]
        return poses

    def _inputs(self, batch: NDArray[np.intp]) -> Tensor:
        """(B, 4, h, w) of (domain number, iid) rows."""
        x = np.empty((len(batch), 4, *self.size), dtype=np.float32)
        for number, name in enumerate(self.domains):
            rows = batch[:, 0] == number
            if rows.any():
                x[rows] = self.frames.domains[name].inputs(batch[rows, 1])
        return torch.from_numpy(x)

    def _end_epoch(self, epoch: int) -> None:
        """Add a row of training and validation figures to the history."""
        parts = [np.empty((2, 0))]
        for number, name in enumerate(self.domains):
            rows = self.held_out[self.held_out[:, 0] == number, 1]
            poses = predict(self.network, self.convention, self.frames.domains[name], rows)
            parts.append(np.stack(pose_errors(poses, self.frames.truth(name)[rows])))
        distance, heading_error = np.concatenate(parts, axis=1)
        row = {"epoch": epoch, "step": self.progress.step, **self.progress.take_means()}
        if len(distance):
            row["validation_median_error"] = float(np.median(distance))
            row["validation_mean_error"] = float(distance.mean())
            row["validation_median_heading_error"] = float(np.median(heading_error))
        self.progress.history.append({key: round(value, 5) for key, value in row.items()})

    def _save(self, path: Path | None) -> None:
        if path is not None:
            write_checkpoint(path, self._state, self.progress, self.facts())

    def facts(self) -> dict[str, Any]:
        """Facts that identify this training."""
        return {
            "recipe": self.recipe.name,
            "architecture": self.network.architecture,
            "seed": self.seed,
            "minutes": self.budget.minutes if self.budget.steps is None else None,
            "steps": self.budget.steps,
            "domains": ",".join(self.domains),
            "training_images": len(self.rows),
            "start": None if self.start is None else self.start.sha256,
            "adjustments": self.adjustments,
        }

    def provenance(self) -> dict[str, str]:
        rules = {"sim": split_rules.SIM_RULE, "real": split_rules.REAL_RULE}
        facts = {
            **self.facts(),
            "description": self.recipe.description,
            "steps_done": self.progress.step,
            "seconds": round(self.progress.seconds, 1),
            "batch": BATCH,
            "learning_rate": self.recipe.learning_rate,
            "weight_decay": WEIGHT_DECAY,
            "split_rule": "; ".join(rules[kind] for kind in self.recipe.learns_from),
            "device": self.device.type,
            "torch": torch.__version__,
            "numpy": np.__version__,
            "threads": torch.get_num_threads(),
            "history": json.dumps(self.progress.history),
        }
        return {key: str(value) for key, value in facts.items() if value is not None}


def _rows(splits: Splits, domains: list[str], code: int) -> NDArray[np.intp]:
    """(M, 2) domain number and iid of the instances with this split code."""
    parts = [np.empty((0, 2), dtype=np.intp)]
    for number, name in enumerate(domains):
        iids = np.flatnonzero(splits[name] == code)
        parts.append(np.stack([np.full(len(iids), number), iids], axis=1))
    return np.concatenate(parts)


def training_loss(predicted: Tensor, truth: Tensor) -> Tensor:
    """Mean of (1 - g) error^2 + g displacement^2 over (B, 4) x, y, cosine, sine, g = 0.3.

    The paper's loss, but with the displacement of a point `HEADING_LEVER` ahead instead of the
    angle: smooth where the angle wraps, and in metres like the other term.
    """
    squares = (predicted - truth).square()
    position, heading = squares[:, :2].sum(dim=1), squares[:, 2:].sum(dim=1)
    return ((1 - LOSS_GAMMA) * position + LOSS_GAMMA * HEADING_LEVER**2 * heading).mean()


def learning_rate_share(done: float) -> float:
    """Share of the learning rate: a linear warm-up, then half a cosine down to zero."""
    if done < WARM_UP:
        return (done + 0.01) / (WARM_UP + 0.01)
    return 0.5 + 0.5 * math.cos(math.pi * (done - WARM_UP) / (1 - WARM_UP))

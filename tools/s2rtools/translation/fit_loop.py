"""The loop of all learned methods: batches, budget, progress, history and checkpoints."""

from __future__ import annotations

import hashlib
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from s2rstore.errors import RequestError
from s2rtools.common.checkpoint import (
    FitProgress,
    FitState,
    read_checkpoint,
    write_checkpoint,
)
from s2rtools.common.torch_device import device
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import FitSettings
from s2rtools.translation.network_translator import to_tensor

CHECKPOINT_SECONDS = 10.0
HISTORY_ROWS = 20
"""Rows of the history of a fit with a known number of steps."""
MINUTES_ROW_STEPS = 50
"""Steps per row of the history of a fit that ends after some minutes."""
CONSTANT_RATE = 0.5
"""Share of the fit with the full learning rate; then it falls linearly to zero."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Crops (B, 3, h, w) in -1 .. 1 of both domains, and the random generator of this step."""

    source: Tensor
    target: Tensor
    generator: torch.Generator


class BatchSampler:
    """Random images, crops and horizontal flips, determined by seed and step.

    With `paired`, both domains have the same rows, crops and flips. Images are flipped only from
    left to right: a floor never becomes a ceiling.
    """

    def __init__(
        self, source: ImageSet, target: ImageSet, crop: tuple[int, int], batch: int,
        seed: int, paired: bool = False,
    ) -> None:  # fmt: skip
        self.sets = (source, target)
        self.crop = min(crop[0], source.size[0]), min(crop[1], source.size[1])
        self.batch, self.seed, self.paired = batch, seed, paired

    def sample(self, step: int) -> Batch:
        """The batch of a step."""
        rng = np.random.default_rng([self.seed, step])
        source = self._crops(0, rng)
        if self.paired:
            rng = np.random.default_rng([self.seed, step])
        target = self._crops(1, rng)
        generator = torch.Generator(device()).manual_seed(self.seed * 1_000_003 + step)
        return Batch(source, target, generator)

    def _crops(self, which: int, rng: np.random.Generator) -> Tensor:
        images = self.sets[which].images
        rows, columns = self.crop
        crops = np.empty((self.batch, rows, columns, 3), dtype=np.uint8)
        for number in range(self.batch):
            image = images[rng.integers(len(images))]
            top = rng.integers(image.shape[0] - rows + 1)
            left = rng.integers(image.shape[1] - columns + 1)
            crop = image[top : top + rows, left : left + columns]
            crops[number] = crop[:, ::-1] if rng.random() < 0.5 else crop
        return to_tensor(crops)


class Learner(ABC):
    """Networks, optimizers and losses of one method; `max_gradient` is the norm to which the
    gradient of each optimizer's parameters is clipped."""

    state: FitState
    max_gradient: float | None = None

    def update(self, loss: Tensor, optimizer: str = "all") -> None:
        """One step of an optimizer of the state."""
        chosen = self.state.optimizers[optimizer]
        chosen.zero_grad()
        loss.backward()
        if self.max_gradient is not None:
            for group in chosen.param_groups:
                torch.nn.utils.clip_grad_norm_(group["params"], self.max_gradient)
        chosen.step()

    @abstractmethod
    def step(self, batch: Batch) -> Mapping[str, Tensor]:
        """Update the networks; returns the losses by name, `loss` among them."""


@dataclass(frozen=True, slots=True)
class FitPlan:
    """A fit: the default number of steps, the learning rate and what identifies it."""

    name: str
    steps: int
    learning_rate: float
    facts: Mapping[str, Any]


def run_fit(
    learner: Learner, sampler: BatchSampler, plan: FitPlan, settings: FitSettings
) -> tuple[list[dict[str, float]], dict[str, Any]]:
    """Train until the budget is used up; returns the history and the facts of the fit.

    With `settings.checkpoint`, the state is saved every few seconds, at the end and after an
    interrupt between two steps; an interrupt inside a step keeps the last saved state. A fit with
    a checkpoint of the same fit continues there. A continued fit of a number of steps gives the
    same result as an uninterrupted one. Raises RequestError where the loss is not finite, and for
    the checkpoint of another fit, which is never overwritten.
    """
    facts = _facts(sampler, plan, settings)
    path = settings.checkpoint
    progress = FitProgress()
    if path is not None and path.exists():
        progress = read_checkpoint(path, learner.state, facts)
    steps = _steps(plan, settings)
    learner.state.network.train().requires_grad_(True)
    saved = time.monotonic()
    consistent = True
    try:
        while (done := _fraction(progress, steps, settings)) < 1:
            began = time.monotonic()
            _set_learning_rate(learner, plan, done)
            batch = sampler.sample(progress.step)
            consistent = False  # An interrupt inside a step leaves networks half updated.
            losses = learner.step(batch)
            values = {name: float(value) for name, value in losses.items()}
            if not math.isfinite(values["loss"]):
                raise RequestError(
                    f"{plan.name}: the loss at step {progress.step} is not finite; fit with "
                    "another seed or fewer channels"
                )
            _record(progress, values, steps)
            progress.seconds += time.monotonic() - began
            consistent = True
            done = _fraction(progress, steps, settings)
            settings.report(done, values["loss"], progress.seconds / max(done, 1e-9) * (1 - done))
            if path is not None and time.monotonic() - saved > CHECKPOINT_SECONDS:
                write_checkpoint(path, learner.state, progress, facts)
                saved = time.monotonic()
    finally:
        if path is not None and consistent:
            write_checkpoint(path, learner.state, progress, facts)
    learner.state.network.eval().requires_grad_(False)
    return progress.history, {
        **plan.facts,
        "steps": progress.step,
        "seconds": round(progress.seconds, 1),
        "images_per_second": round(progress.step * sampler.batch / max(progress.seconds, 1e-9), 2),
        "batch": sampler.batch,
        "crop": list(sampler.crop),
        "learning_rate": plan.learning_rate,
        "device": device().type,
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
    }


def _steps(plan: FitPlan, settings: FitSettings) -> int | None:
    if settings.steps is not None:
        return max(0, settings.steps)
    return plan.steps if settings.minutes is None else None


def _fraction(progress: FitProgress, steps: int | None, settings: FitSettings) -> float:
    if steps is not None:
        return min(1.0, progress.step / steps) if steps else 1.0
    return min(1.0, progress.seconds / max(1e-9, (settings.minutes or 0) * 60))


def _set_learning_rate(learner: Learner, plan: FitPlan, done: float) -> None:
    share = min(1.0, (1 - done) / (1 - CONSTANT_RATE))
    for optimizer in learner.state.optimizers.values():
        for group in optimizer.param_groups:
            group["lr"] = plan.learning_rate * share


def _record(progress: FitProgress, losses: Mapping[str, float], steps: int | None) -> None:
    """Count the step; add a row of mean losses to the history at the end of each interval."""
    progress.add(losses)
    interval = MINUTES_ROW_STEPS if steps is None else max(1, steps // HISTORY_ROWS)
    if progress.step % interval == 0 or progress.step == steps:
        row = {"step": float(progress.step), **progress.take_means()}
        progress.history.append({key: round(value, 5) for key, value in row.items()})


def _facts(sampler: BatchSampler, plan: FitPlan, settings: FitSettings) -> dict[str, Any]:
    """What a checkpoint has to agree with."""
    digest = hashlib.sha256()
    for images in sampler.sets:
        digest.update(images.images.tobytes())
    return {
        "fit": plan.name,
        "seed": settings.seed,
        "steps": _steps(plan, settings),
        "minutes": settings.minutes,
        "paired": settings.paired,
        "crop": list(sampler.crop),
        "batch": sampler.batch,
        "learning_rate": plan.learning_rate,
        "images": digest.hexdigest(),
        **plan.facts,
    }

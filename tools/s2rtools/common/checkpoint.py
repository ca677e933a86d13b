"""Checkpoints of unfinished fits: modules, optimizers and tensors as a safetensors file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn
from torch.optim import Optimizer

from s2rstore.errors import RequestError
from s2rstore.files.atomic_writes import write_file
from s2rstore.files.input_files import check_regular


@dataclass(slots=True)
class FitProgress:
    """Progress of a fit; the seed and `step` determine all batches and noise."""

    step: int = 0
    seconds: float = 0.0
    loss_sums: dict[str, float] = field(default_factory=dict)
    summed_steps: int = 0
    history: list[dict[str, float]] = field(default_factory=list)

    def add(self, losses: Mapping[str, float]) -> None:
        """Count a step with its losses by name."""
        self.step += 1
        self.summed_steps += 1
        for name, value in losses.items():
            self.loss_sums[name] = self.loss_sums.get(name, 0.0) + value

    def take_means(self) -> dict[str, float]:
        """Mean losses of the steps since the last call."""
        means = {name: value / self.summed_steps for name, value in self.loss_sums.items()}
        self.loss_sums, self.summed_steps = {}, 0
        return means


@dataclass(frozen=True, slots=True, eq=False)
class FitState:
    """What changes during a fit; `buffers` are written and restored in place."""

    network: nn.Module
    optimizers: Mapping[str, Optimizer]
    buffers: Mapping[str, Tensor] = field(default_factory=dict)


def write_checkpoint(
    path: Path, state: FitState, progress: FitProgress, facts: dict[str, Any]
) -> None:
    """Replace the file atomically; `facts` identify the fit."""
    tensors = {f"network/{key}": value for key, value in state.network.state_dict().items()}
    tensors |= {f"buffer/{key}": value for key, value in state.buffers.items()}
    for name, optimizer in state.optimizers.items():
        for number, values in optimizer.state_dict()["state"].items():
            tensors |= {f"optimizer/{name}/{number}/{key}": v for key, v in values.items()}
    header = {"facts": json.dumps(facts, sort_keys=True), "progress": json.dumps(asdict(progress))}
    # A module that two networks share appears twice, which safetensors refuses without a copy.
    plain = {key: value.detach().cpu().contiguous().clone() for key, value in tensors.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, save(plain, header))


def read_checkpoint(path: Path, state: FitState, facts: dict[str, Any]) -> FitProgress:
    """Restore `state` and give the progress.

    Raises RequestError, and leaves `state` unchanged, if the file is that of a fit with other
    facts, which it names, or damaged.
    """
    check_regular(path)
    try:
        with safe_open(path, framework="pt") as file:
            header = file.metadata() or {}
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (OSError, ValueError, SafetensorError) as error:
        raise RequestError(
            f"{path}: not a checkpoint ({error}); remove it to start again"
        ) from error
    try:
        if others := _differences(json.loads(header["facts"]), facts):
            raise RequestError(
                f"{path}: checkpoint of another fit (other {', '.join(others)}); repeat that fit, "
                "or remove the file to start again"
            )
        _restore(tensors, state)
        return FitProgress(**json.loads(header["progress"]))
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise RequestError(
            f"{path}: damaged checkpoint ({reason}); remove it to start again"
        ) from error


def _differences(stored: dict[str, Any], facts: dict[str, Any]) -> list[str]:
    """The names of the facts in which two fits differ."""
    facts = json.loads(json.dumps(facts))
    names = sorted(stored.keys() | facts.keys())
    return [name for name in names if stored.get(name) != facts.get(name)]


def _restore(tensors: Mapping[str, Tensor], state: FitState) -> None:
    def group(name: str) -> dict[str, Tensor]:
        prefix = f"{name}/"
        found = tensors.items()
        return {key.removeprefix(prefix): v for key, v in found if key.startswith(prefix)}

    state.network.load_state_dict(group("network"))
    for name, value in group("buffer").items():
        state.buffers[name].copy_(value)
    for name, optimizer in state.optimizers.items():
        moments: dict[int, dict[str, Tensor]] = {}
        for key, value in group(f"optimizer/{name}").items():
            number, _, moment = key.partition("/")
            moments.setdefault(int(number), {})[moment] = value
        optimizer.load_state_dict({**optimizer.state_dict(), "state": moments})

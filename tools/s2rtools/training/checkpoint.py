"""Checkpoints: the state of an unfinished training as a safetensors file with a JSON header."""

from __future__ import annotations

import json
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
class TrainingProgress:
    """Progress of a training; seed and `step` determine all batches and augmentations."""

    step: int = 0
    seconds: float = 0.0
    loss_sum: float = 0.0
    history: list[dict[str, float]] = field(default_factory=list)


def write_checkpoint(
    path: Path,
    network: nn.Module,
    optimizer: Optimizer,
    progress: TrainingProgress,
    facts: dict[str, Any],
) -> None:
    """Replace the file atomically; `facts` identify the training."""
    tensors = {f"network/{key}": value for key, value in network.state_dict().items()}
    for number, values in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{number}/{key}": value for key, value in values.items()}
    header = {"facts": json.dumps(facts, sort_keys=True), "progress": json.dumps(asdict(progress))}
    plain = {key: value.detach().cpu().contiguous() for key, value in tensors.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, save(plain, header))


def read_checkpoint(
    path: Path, network: nn.Module, optimizer: Optimizer, facts: dict[str, Any]
) -> TrainingProgress:
    """Restore the state. Raises RequestError if the file is damaged or of another training."""
    check_regular(path)
    try:
        with safe_open(path, framework="pt") as file:
            header = file.metadata() or {}
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (OSError, ValueError, SafetensorError) as error:
        raise RequestError(
            f"{path}: not a checkpoint ({error}); remove it to start again"
        ) from error
    if header.get("facts") != json.dumps(facts, sort_keys=True):
        raise RequestError(f"{path}: checkpoint of another training; remove it to start again")
    states: dict[int, dict[str, Tensor]] = {}
    weights = {}
    for key, value in tensors.items():
        group, _, rest = key.partition("/")
        if group == "network":
            weights[rest] = value
        else:
            number, _, name = rest.partition("/")
            states.setdefault(int(number), {})[name] = value
    network.load_state_dict(weights)
    optimizer.load_state_dict({**optimizer.state_dict(), "state": states})
    return TrainingProgress(**json.loads(header["progress"]))

"""An image network from a local weights file, described by a small TOML or JSON file.

    architecture = "inception_v3_fid"      one of `ARCHITECTURES`
    weights = "inception.safetensors"      a plain state dict; relative to this file
    sha256 = "..."                         of the weights (optional; anything else is refused)
    [preprocessing]                        of RGB images in [0, 1]:
    size = [299, 299]                      rows, columns
    filter = "bilinear"                    nearest, bilinear, bicubic or area
    range = [-1.0, 1.0]                    what 0 and 1 become; or mean = [r, g, b], std = [r, g, b]

Weights and preprocessing make a fingerprint: features of two fingerprints are never compared.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_document
from s2rtools.gap.visual.inception import FidInception
from s2rtools.models.weights_file import (
    check_tensors,
    max_file_bytes,
    parameter_bytes,
    read_state,
    read_weights_file,
)

ARCHITECTURES: dict[str, type[FidInception]] = {"inception_v3_fid": FidInception}
FILTERS = {
    "nearest": cv2.INTER_NEAREST,
    "bilinear": cv2.INTER_LINEAR,
    "bicubic": cv2.INTER_CUBIC,
    "area": cv2.INTER_AREA,
}
_KEYS = {"architecture", "weights", "sha256", "preprocessing"}
_STEPS = {"size", "filter", "range", "mean", "std"}
_IGNORED = ("fc.", "AuxLogits.")
_SIZES = (75, 1024)


@dataclass(frozen=True, slots=True)
class Preprocessing:
    """y = (resized - mean) / std per channel, of RGB in [0, 1]; `size` is (rows, columns)."""

    size: tuple[int, int]
    filter: str
    mean: tuple[float, float, float]
    std: tuple[float, float, float]

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        """(B, H, W, 3) -> (B, 3, h, w)."""
        height, width = self.size
        method = FILTERS[self.filter]
        scaled = [
            cv2.resize(np.float32(image) / 255, (width, height), interpolation=method)
            for image in rgb
        ]
        mean, std = (np.array(figures, dtype=np.float32) for figures in (self.mean, self.std))
        y = (np.stack(scaled) - mean) / std
        return np.ascontiguousarray(np.moveaxis(y, -1, 1))


@dataclass(frozen=True, slots=True, eq=False)
class ImageNetwork:
    """A network in evaluation mode, with all that its features depend on."""

    network: nn.Module
    preprocessing: Preprocessing
    identity: dict[str, str | int | float]

    def features(self, rgb: NDArray[np.uint8], batch: int = 16) -> NDArray[np.float64]:
        """(n, H, W, 3) -> (n, d)."""
        found = []
        with torch.inference_mode():
            for start in range(0, len(rgb), batch):
                x = torch.from_numpy(self.preprocessing(rgb[start : start + batch]))
                found.append(self.network(x).double().numpy())
        return np.concatenate(found)


def read_network(path: Path) -> ImageNetwork:
    """Raises RequestError naming the file and what is wrong with it."""
    described = _table(path)
    architecture = described.get("architecture")
    if not isinstance(architecture, str) or architecture not in ARCHITECTURES:
        raise RequestError(f"{path}: architecture must be one of {', '.join(ARCHITECTURES)}")
    preprocessing = _preprocessing(described.get("preprocessing"), path)
    weights = described.get("weights")
    if not isinstance(weights, str) or not weights:
        raise RequestError(f"{path}: weights must name a file of weights")
    file = path.parent / weights
    network = ARCHITECTURES[architecture]()
    try:
        content = read_weights_file(file, max_file_bytes(parameter_bytes(network.state_dict())))
    except RequestError as error:
        raise RequestError(f"{error}; {path} names it") from error
    digest = hashlib.sha256(content).hexdigest()
    if described.get("sha256", digest) != digest:
        raise RequestError(f"{file}: its sha256 is {digest}, {path} says {described['sha256']}")
    _fill(network, read_state(file, content), file)
    network.eval().requires_grad_(False)
    return ImageNetwork(network, preprocessing, _identity(architecture, digest, preprocessing))


def _identity(
    architecture: str, digest: str, preprocessing: Preprocessing
) -> dict[str, str | int | float]:
    steps = asdict(preprocessing)
    whole = hashlib.sha256(json.dumps([digest, steps], sort_keys=True).encode()).hexdigest()
    return {
        "features": f"{architecture}:{ARCHITECTURES[architecture].layer}",
        "features_sha256": whole,
        "weights_sha256": digest,
        "resize": f"{preprocessing.filter} {preprocessing.size[0]}x{preprocessing.size[1]}",
        "range": json.dumps([steps["mean"], steps["std"]]),
    }


def _table(path: Path) -> dict[str, Any]:
    data = read_document(path)
    if not isinstance(data, dict):
        raise RequestError(f"{path}: must be a table of architecture, weights, preprocessing")
    for name in sorted(set(data) - _KEYS):
        raise RequestError(f"{path}: unknown key {name!r} (known: {', '.join(sorted(_KEYS))})")
    return data


def _preprocessing(steps: Any, path: Path) -> Preprocessing:
    if not isinstance(steps, dict):
        raise RequestError(f"{path}: [preprocessing] is missing: size, filter, range")
    for name in sorted(set(steps) - _STEPS):
        raise RequestError(f"{path}: preprocessing: unknown key {name!r}")
    size, low, high = steps.get("size"), *_SIZES
    if (
        not isinstance(size, list)
        or len(size) != 2
        or not all(type(v) is int and low <= v <= high for v in size)
    ):
        raise RequestError(f"{path}: preprocessing.size must be [rows, columns], {low} .. {high}")
    if steps.get("filter") not in FILTERS:
        raise RequestError(f"{path}: preprocessing.filter must be one of {', '.join(FILTERS)}")
    if "range" in steps:
        a, b = _numbers(steps, "range", 2, path)
        if not a < b or "mean" in steps or "std" in steps:
            raise RequestError(f"{path}: preprocessing: range = [low, high], or mean and std")
        mean, std = (-a / (b - a),) * 3, (1 / (b - a),) * 3
    else:
        mean, std = _numbers(steps, "mean", 3, path), _numbers(steps, "std", 3, path)
        if min(std) <= 0:
            raise RequestError(f"{path}: preprocessing.std must be above 0")
    return Preprocessing((size[0], size[1]), steps["filter"], mean, std)


def _numbers(steps: dict[str, Any], name: str, count: int, path: Path) -> Any:
    values: Any = steps.get(name)
    good = isinstance(values, list) and len(values) == count
    if not good or not all(type(v) in (int, float) and math.isfinite(v) for v in values):
        raise RequestError(f"{path}: preprocessing.{name} must be {count} numbers")
    return tuple(float(v) for v in values)


def _fill(network: nn.Module, state: dict[str, Tensor], file: Path) -> None:
    """Load weights; the classifier and counters that no feature needs may be there."""
    wanted = network.state_dict()
    needed = [key for key in wanted if not key.endswith("num_batches_tracked")]
    missing = [key for key in needed if key not in state]
    extra = [key for key in state if key not in wanted and not key.startswith(_IGNORED)]
    shaped = [key for key in needed if key in state and state[key].shape != wanted[key].shape]
    for what, keys in (("no", missing), ("unknown", extra), ("wrong shape of", shaped)):
        if keys:
            more = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
            raise RequestError(f"{file}: {what} {keys[0]}{more}; weights of another architecture?")
    check_tensors(state, wanted, str(file))
    broken = [key for key in needed if not state[key].isfinite().all()]
    if broken:
        raise RequestError(f"{file}: {broken[0]} holds values that are not finite")
    network.load_state_dict({key: state[key] for key in wanted if key in state}, strict=False)

"""Image networks from local weights files, each described by a TOML or JSON file.

    architecture = "inception_v3_fid"      one of `ARCHITECTURES`
    weights = "inception.safetensors"      a plain state dict; relative to this file
    sha256 = "..."                         hash of the weights, which is checked (optional)
    [preprocessing]                        of RGB images in [0, 1]:
    size = [299, 299]                      rows, columns
    filter = "bilinear"                    nearest, bilinear, bicubic or area
    range = [-1.0, 1.0]                    images of 0 and 1; or mean = [r, g, b], std = [r, g, b]

Features are compared only if the fingerprints of weights and preprocessing are equal.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
from msgspec import Meta, Struct
from numpy.typing import NDArray
from torch import Tensor, nn

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_document
from s2rtools.common.documents import convert
from s2rtools.common.weights_file import (
    check_tensors,
    max_file_bytes,
    parameter_bytes,
    read_state,
    read_weights_file,
)
from s2rtools.gap.visual.inception import FidInception

ARCHITECTURES: dict[str, type[FidInception]] = {"inception_v3_fid": FidInception}
FILTERS = {
    "nearest": cv2.INTER_NEAREST,
    "bilinear": cv2.INTER_LINEAR,
    "bicubic": cv2.INTER_CUBIC,
    "area": cv2.INTER_AREA,
}
_IGNORED = ("fc.", "AuxLogits.")
"""Weights of the classifier, which no feature needs."""
Edge = Annotated[int, Meta(ge=75, le=1024)]
Triple = tuple[float, float, float]


class PreprocessingTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The section [preprocessing]."""

    size: tuple[Edge, Edge]
    filter: str
    range: tuple[float, float] | None = None
    mean: Triple | None = None
    std: Triple | None = None


class NetworkFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The file that describes a network."""

    architecture: str
    weights: str
    preprocessing: PreprocessingTable
    sha256: str | None = None


@dataclass(frozen=True, slots=True)
class Preprocessing:
    """y = (resized - mean) / std per channel, of RGB in [0, 1]; `size` is (rows, columns)."""

    size: tuple[int, int]
    filter: str
    mean: Triple
    std: Triple

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
    """A network in evaluation mode; `identity` holds everything that its features depend on."""

    network: nn.Module
    preprocessing: Preprocessing
    identity: dict[str, str | int | float]

    def features(self, rgb: NDArray[np.uint8], batch: int = 16) -> NDArray[np.float64]:
        """(n, H, W, 3) -> (n, d)."""
        batches = []
        with torch.inference_mode():
            for start in range(0, len(rgb), batch):
                x = torch.from_numpy(self.preprocessing(rgb[start : start + batch]))
                batches.append(self.network(x).double().numpy())
        return np.concatenate(batches)


def read_network(path: Path) -> ImageNetwork:
    """Read a description and its weights. Raises RequestError that names the file and the fault."""
    described = convert(read_document(path), NetworkFile, str(path))
    architecture = ARCHITECTURES.get(described.architecture)
    if architecture is None:
        raise RequestError(f"{path}: architecture must be one of {', '.join(ARCHITECTURES)}")
    preprocessing = _preprocessing(described.preprocessing, path)
    file = path.parent / described.weights
    network = architecture()
    try:
        content = read_weights_file(file, max_file_bytes(parameter_bytes(network.state_dict())))
    except RequestError as error:
        raise RequestError(f"{error}; {path} names it") from error
    digest = hashlib.sha256(content).hexdigest()
    if described.sha256 not in (None, digest):
        raise RequestError(f"{file}: its sha256 is {digest}, {path} says {described.sha256}")
    _fill(network, read_state(file, content), file)
    network.eval().requires_grad_(False)
    steps = asdict(preprocessing)
    fingerprint = json.dumps([digest, steps], sort_keys=True)
    identity: dict[str, str | int | float] = {
        "features": f"{described.architecture}:{architecture.layer}",
        "features_sha256": hashlib.sha256(fingerprint.encode()).hexdigest(),
        "weights_sha256": digest,
        "resize": f"{preprocessing.filter} {preprocessing.size[0]}x{preprocessing.size[1]}",
        "range": json.dumps([steps["mean"], steps["std"]]),
    }
    return ImageNetwork(network, preprocessing, identity)


def _preprocessing(table: PreprocessingTable, path: Path) -> Preprocessing:
    if table.filter not in FILTERS:
        raise RequestError(f"{path}: preprocessing.filter must be one of {', '.join(FILTERS)}")
    if table.range is not None and table.mean is table.std is None:
        low, high = table.range
        if low >= high:
            raise RequestError(f"{path}: preprocessing.range must be [low, high]")
        mean, std = (-low / (high - low),) * 3, (1 / (high - low),) * 3
        return Preprocessing(table.size, table.filter, mean, std)
    if table.range is not None or table.mean is None or table.std is None:
        raise RequestError(f"{path}: preprocessing: expected either range, or mean and std")
    if min(table.std) <= 0:
        raise RequestError(f"{path}: preprocessing.std must be above 0")
    return Preprocessing(table.size, table.filter, table.mean, table.std)


def _fill(network: nn.Module, state: dict[str, Tensor], file: Path) -> None:
    """Load weights; ignore those of the classifier, and batch counters."""
    expected = network.state_dict()
    required = [key for key in expected if not key.endswith("num_batches_tracked")]
    missing = [key for key in required if key not in state]
    extra = [key for key in state if key not in expected and not key.startswith(_IGNORED)]
    shaped = [key for key in required if key in state and state[key].shape != expected[key].shape]
    for fault, keys in (("no", missing), ("unknown", extra), ("wrong shape of", shaped)):
        if keys:
            more = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
            raise RequestError(f"{file}: {fault} {keys[0]}{more}; weights of another architecture?")
    check_tensors(state, expected, str(file))
    for key in required:
        if not state[key].isfinite().all():
            raise RequestError(f"{file}: {key} holds values that are not finite")
    network.load_state_dict({key: state[key] for key in expected if key in state}, strict=False)

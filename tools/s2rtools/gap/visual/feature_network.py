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
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
from msgspec import Meta, Struct
from numpy.typing import NDArray
from torch import nn

from s2rstore.errors import RequestError
from s2rstore.files.documents import read_document
from s2rtools.common.typed_documents import convert
from s2rtools.common.weights_file import (
    fill,
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


class Preprocessing(Struct, frozen=True, forbid_unknown_fields=True):
    """The section [preprocessing]: y = (resized - mean) / std per channel, of RGB in [0, 1].

    `size` is (rows, columns).
    """

    size: tuple[Edge, Edge]
    filter: str
    range: tuple[float, float] | None = None
    mean: Triple | None = None
    std: Triple | None = None

    def normalised(self, path: Path) -> Preprocessing:
        """The section with `mean` and `std` in place of `range`.

        Raises RequestError, beginning with the path of the file, for values that do not fit.
        """
        if self.filter not in FILTERS:
            raise RequestError(f"{path}: preprocessing.filter must be one of {', '.join(FILTERS)}")
        mean, std = self.mean, self.std
        if self.range is not None and mean is std is None:
            low, high = self.range
            if low >= high:
                raise RequestError(f"{path}: preprocessing.range must be [low, high]")
            mean, std = (-low / (high - low),) * 3, (1 / (high - low),) * 3
        elif self.range is not None or mean is None or std is None:
            raise RequestError(f"{path}: preprocessing: expected either range, or mean and std")
        if min(std) <= 0:
            raise RequestError(f"{path}: preprocessing.std must be above 0")
        return Preprocessing(self.size, self.filter, None, mean, std)

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        """(B, H, W, 3) -> (B, 3, h, w)."""
        height, width = self.size
        scaled = [
            cv2.resize(np.float32(image) / 255, (width, height), interpolation=FILTERS[self.filter])
            for image in rgb
        ]
        mean, std = (np.array(figures, dtype=np.float32) for figures in (self.mean, self.std))
        y = (np.stack(scaled) - mean) / std
        return np.ascontiguousarray(np.moveaxis(y, -1, 1))


class NetworkFile(Struct, frozen=True, forbid_unknown_fields=True):
    """The file that describes a network."""

    architecture: str
    weights: str
    preprocessing: Preprocessing
    sha256: str | None = None


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
    preprocessing = described.preprocessing.normalised(path)
    file = path.parent / described.weights
    network = architecture()
    try:
        content = read_weights_file(file, max_file_bytes(parameter_bytes(network.state_dict())))
    except RequestError as error:
        raise RequestError(f"{error}; {path} names it") from error
    digest = hashlib.sha256(content).hexdigest()
    if described.sha256 not in (None, digest):
        raise RequestError(f"{file}: its sha256 is {digest}, {path} says {described.sha256}")
    fill(network, read_state(file, content), str(file), "another architecture?", _IGNORED)
    network.eval().requires_grad_(False)
    steps = {key: getattr(preprocessing, key) for key in ("size", "filter", "mean", "std")}
    fingerprint = json.dumps([digest, steps], sort_keys=True)
    identity: dict[str, str | int | float] = {
        "features": f"{described.architecture}:{architecture.layer}",
        "features_sha256": hashlib.sha256(fingerprint.encode()).hexdigest(),
        "weights_sha256": digest,
        "resize": f"{preprocessing.filter} {preprocessing.size[0]}x{preprocessing.size[1]}",
        "range": json.dumps([steps["mean"], steps["std"]]),
    }
    return ImageNetwork(network, preprocessing, identity)

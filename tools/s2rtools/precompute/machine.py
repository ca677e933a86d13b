"""The device and the libraries of a machine that computes arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import metadata

import torch

from s2rstore.files.compute_environment import ComputeEnvironment
from s2rtools.inference.backend import processor_name

_NUMERIC = (
    "torch", "openvino", "numpy", "opencv-python-headless", "scipy", "scikit-learn", "umap-learn",
    "numba",
)  # fmt: skip
"""Packages on whose version values depend."""


@dataclass(frozen=True, slots=True)
class Machine:
    """Models of the processor and of the GPU (empty without one), and versions of libraries."""

    processor: str
    gpu: str
    versions: tuple[tuple[str, str], ...]

    def environment(
        self, precision: str, threads: int, uses_gpu: bool = False
    ) -> ComputeEnvironment:
        device = self.gpu if uses_gpu else self.processor
        return ComputeEnvironment(device, precision, threads, dict(self.versions))


@cache
def this_machine() -> Machine:
    """The machine that this process runs on."""
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else ""
    return Machine(processor_name(), gpu, tuple(numeric_versions().items()))


def numeric_versions() -> dict[str, str]:
    """The versions of the installed packages on which values depend."""
    versions = {}
    for name in _NUMERIC:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions

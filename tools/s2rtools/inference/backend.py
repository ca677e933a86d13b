"""The forward pass of a model: in torch on the processor, and what all backends share."""

from __future__ import annotations

import copy
import platform
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from s2rstore.errors import RequestError
from s2rtools.incremental_inference import BaseOutputs, BasePass
from s2rtools.inference.trunk_rewriting import fold_batch_norm, split_first_convolution
from s2rtools.models.input_check import last_line
from s2rtools.models.pose_network import LoadedModel

BATCH = 8
CHANGED_PIXELS = 32 * 128 * 128
"""Pixels of the inputs in a batch of `Backend.poses`: more inputs at once take less time each."""


@dataclass(frozen=True, slots=True, eq=False)
class ForwardOutput:
    """x (B, C, h, w) and features (B, F, fh, fw) as tensors; embedding (B, D) and pose (B, 3).

    `features` is None for a network without accessible features. `base` are the outputs of all
    operations of the trunk, where the backend keeps them.
    """

    x: Tensor
    features: Tensor | None
    embedding: Tensor
    pose: NDArray[np.float64]
    base: BaseOutputs | None = None


def is_float32(precision: str) -> bool:
    """Whether a backend of some `precision` computes in float32."""
    return precision in ("float32", "openvino f32")


class Backend:
    """torch in float32 on the processor; deterministic for a given number of threads.

    `name` and `precision` belong to the keys of arrays, so they state all that changes the values
    by more than the order of additions does: a backend of another device has another name. `trunk`
    is the network's trunk in float32 with batch norm folded, None without accessible features.
    `differences` is the precision of the differences from which occlusion is computed. `base_pass`
    runs the trunk where the outputs of its operations are kept.
    """

    name: ClassVar[str] = "torch"
    library: ClassVar[str] = "torch"
    device: ClassVar[torch.device] = torch.device("cpu")
    precision = "float32"
    batch = BATCH
    differences = "float32"
    base_pass: BasePass | None = None

    def __init__(self, model: LoadedModel, threads: int = 0) -> None:
        """`threads` 0 keeps torch's setting."""
        if threads:
            torch.set_num_threads(threads)
        self.model = model
        self.trunk: nn.Module | None = None
        if model.network.has_features:
            self.trunk = fold_batch_norm(model.network.trunk).to(self.device)

    @property
    def device_name(self) -> str:
        """The processor or GPU that computes."""
        return processor_name()

    @property
    def is_float32(self) -> bool:
        """Whether poses are computed in float32."""
        return is_float32(self.precision)

    @cached_property
    def split_trunk(self) -> tuple[nn.Module, nn.Module]:
        """`trunk` as a first part that is linear up to a constant, and the rest.

        Raises RequestError for a network without accessible features.
        """
        if self.trunk is None:
            raise RequestError(f"model {self.model.name!r} has no accessible feature maps")
        return split_first_convolution(self.trunk)

    @classmethod
    def unavailable_reason(cls) -> str | None:
        """What this machine lacks for the backend; None if it can be opened."""
        return None

    @classmethod
    def is_accelerated(cls) -> bool:
        """Whether this machine has what makes the backend faster than torch in float32.

        A property of the machine and its packages, never of its load.
        """
        return cls.unavailable_reason() is None

    @classmethod
    def suits(cls, model: LoadedModel) -> bool:
        """Whether the backend can run a model, and may be faster than others."""
        return True

    def run_trunk(self, x: Tensor) -> tuple[Tensor, BaseOutputs | None]:
        """Trunk features in float32, and the outputs of all operations if they are kept."""
        return self.features(x), None

    def features(self, x: Tensor) -> Tensor:
        """Trunk features in float32."""
        if self.trunk is None:
            raise RequestError(f"model {self.model.name!r} has no accessible feature maps")
        return self.trunk(x.contiguous(memory_format=torch.channels_last)).float()

    def pose(self, raw: Tensor) -> NDArray[np.float64]:
        """Decoded poses (B, 3) in metres, metres, radians."""
        return self.model.convention.decode(raw.double()).cpu().numpy()

    def forward_all(self, x: NDArray[np.float32]) -> ForwardOutput:
        """Results of one forward pass over a batch of inputs."""
        with torch.inference_mode():
            tensor = torch.from_numpy(x).to(self.device)
            if self.trunk is None:
                raw = self._opaque_output(tensor)
                return ForwardOutput(tensor, None, raw, self.pose(raw))
            features, base = self.run_trunk(tensor)
            embedding = self.model.network.embed(features)
            raw = self.model.network.head(embedding)
            for name, values in (("features", features), ("embeddings", embedding)):
                if len(values) != len(tensor):
                    raise self._error(f"returns {len(values)} {name} for {len(tensor)} images")
            pose = self.pose(self._checked(raw, tensor))
            return ForwardOutput(tensor, features, embedding, pose, base)

    def input_only(self, x: NDArray[np.float32]) -> ForwardOutput:
        """The input batch on the backend's device without a forward pass: poses are NaN."""
        tensor = torch.from_numpy(x).to(self.device)
        return ForwardOutput(
            tensor, None, tensor.new_empty(len(x), 0), np.full((len(x), 3), np.nan)
        )

    def poses(self, x: NDArray[np.float32]) -> NDArray[np.float64]:
        """Poses (n, 3) of any number of inputs, in batches that the device takes.

        On a CPU, small inputs make larger batches; a GPU's batch is the largest that fits.
        """
        batch = self.batch
        if len(x) and self.device.type == "cpu":
            batch = max(batch, CHANGED_PIXELS // max(1, x[0, 0].size))
        batches = range(0, len(x), batch)
        found = [self.forward_all(x[start : start + batch]).pose for start in batches]
        return np.concatenate(found) if found else np.zeros((0, 3))

    def _opaque_output(self, x: Tensor) -> Tensor:
        """Checked output of a network without accessible features."""
        try:
            raw: object = self.model.network(x)
        except Exception as error:  # the module's code may raise anything
            raise self._error(f"fails on {len(x)} images: {last_line(error)}") from error
        return self._checked(raw, x)

    def _checked(self, raw: object, x: Tensor) -> Tensor:
        """The raw output, if its shape fits the batch and the convention."""
        expected = len(x), self.model.convention.width
        if not isinstance(raw, Tensor):
            raise self._error(f"returns {type(raw).__name__}, not a tensor")
        shape = tuple(raw.shape)
        if shape != expected:
            raise self._error(f"returns {shape} for {len(x)} images, expected {expected}")
        return raw

    def _error(self, reason: str) -> RequestError:
        return RequestError(f"model {self.model.name!r}: {reason}; export it for any batch size")


class Bfloat16Backend(Backend):
    """torch with the trunk in bfloat16; pooling and linear layers in float32."""

    name = "torch-bfloat16"
    precision = "bfloat16"

    def __init__(self, model: LoadedModel, threads: int = 0) -> None:
        super().__init__(model, threads)
        self._reduced = None
        if self.trunk is not None:
            self._reduced = copy.deepcopy(self.trunk).to(torch.bfloat16)

    @classmethod
    def is_accelerated(cls) -> bool:
        return has_bfloat16_units()

    def features(self, x: Tensor) -> Tensor:
        if self._reduced is None:
            return super().features(x)
        x = x.to(torch.bfloat16).contiguous(memory_format=torch.channels_last)
        features: Tensor = self._reduced(x)
        return features.float()


@cache
def processor_name() -> str:
    """Model name of the processor, or its architecture where the system tells no name."""
    return _cpuinfo("model name") or platform.processor() or platform.machine()


def has_bfloat16_units() -> bool:
    """Whether the processor has matrix units for bfloat16 (AMX)."""
    return "amx_bf16" in _cpuinfo("flags").split()


@cache
def _cpuinfo(field: str) -> str:
    """The value of a field for the first processor; empty where the system does not tell it."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith(field):
                return line.partition(":")[2].strip()
    return ""

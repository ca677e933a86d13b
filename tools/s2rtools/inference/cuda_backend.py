"""Backends of torch on a GPU."""

from __future__ import annotations

import copy
from contextlib import nullcontext
from dataclasses import replace
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from s2rtools.inference.backend import Backend
from s2rtools.models.pose_network import LoadedModel

_LARGEST_BATCH = 64
_SHARE = 0.25
"""Share of the GPU's free memory that one batch may take."""


class CudaBackend(Backend):
    """torch in float32 on the first GPU, without TF32; cuDNN chooses deterministic algorithms.

    It works on a copy of the network, so that the model given stays on the processor.
    """

    name = "cuda"
    device = torch.device("cuda", 0)
    autocast: ClassVar[torch.dtype | None] = None

    def __init__(self, model: LoadedModel, threads: int = 0) -> None:
        torch.backends.cudnn.allow_tf32 = False
        torch.backends.cuda.matmul.allow_tf32 = False
        torch.backends.cudnn.deterministic = True
        torch.backends.cudnn.benchmark = False
        network = copy.deepcopy(model.network).to(self.device)
        super().__init__(replace(model, network=network), threads)
        self.batch = self._fitting_batch()

    @classmethod
    def unavailable_reason(cls) -> str | None:
        return None if torch.cuda.is_available() else "needs a GPU that torch can use"

    @property
    def device_name(self) -> str:
        return str(torch.cuda.get_device_name(self.device))

    def features(self, x: Tensor) -> Tensor:
        reduced = self.autocast is not None
        with torch.autocast("cuda", self.autocast) if reduced else nullcontext():
            return super().features(x)

    def _fitting_batch(self) -> int:
        """The largest power of two, at most 64, whose forward pass fits the free memory."""
        image = np.zeros((1, *self.model.contract.shape), dtype=np.float32)
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats(self.device)
        before = torch.cuda.memory_allocated(self.device)
        self.forward_all(image)
        needed = max(1, torch.cuda.max_memory_allocated(self.device) - before)
        free, _ = torch.cuda.mem_get_info(self.device)
        fitting = max(1, int(free * _SHARE / needed))
        return min(_LARGEST_BATCH, 1 << (fitting.bit_length() - 1))


class CudaFloat16Backend(CudaBackend):
    """The trunk under autocast to float16; pooling and linear layers in float32."""

    name = "cuda-float16"
    precision = "float16"
    autocast = torch.float16


class CudaBfloat16Backend(CudaBackend):
    """The trunk under autocast to bfloat16; pooling and linear layers in float32."""

    name = "cuda-bfloat16"
    precision = "bfloat16"
    autocast = torch.bfloat16

"""The forward pass in float32 by Winograd's algorithm; occlusion goes on from what it keeps."""

from __future__ import annotations

import torch
from torch import Tensor

from s2rstore.errors import RequestError
from s2rtools.incremental_inference import BaseOutputs, BasePass, LocalGraph
from s2rtools.incremental_inference.graph import NotLocalError
from s2rtools.inference.backend import BATCH, Backend
from s2rtools.inference.trunk_rewriting import fold_batch_norm
from s2rtools.models.pose_network import LoadedModel

_KEPT_PIXELS = BATCH * 256 * 256
"""Pixels of the inputs in a batch: `posest` keeps about 700 bytes of outputs for each."""


class WinogradBackend(Backend):
    """torch in float32, 3 x 3 convolutions by Winograd's algorithm where it saves time.

    For trunks of local operations. It keeps the outputs of all operations, from which occlusion is
    recomputed locally.
    """

    name = "winograd"

    def __init__(self, model: LoadedModel, threads: int = 0) -> None:
        """Raises RequestError for a model that it does not suit."""
        super().__init__(model, threads)
        reason = _unsuitable(self.trunk)
        if reason is not None or self.trunk is None:
            raise RequestError(f"model {model.name!r}: backend {self.name!r}: {reason}")
        self.base_pass = BasePass(LocalGraph(self.trunk))
        width, height = model.contract.size
        self.batch = max(1, min(BATCH, _KEPT_PIXELS // (width * height)))

    @classmethod
    def suits(cls, model: LoadedModel) -> bool:
        trunk = fold_batch_norm(model.network.trunk) if model.network.has_features else None
        return _unsuitable(trunk) is None

    def run_trunk(self, x: Tensor) -> tuple[Tensor, BaseOutputs]:
        assert self.base_pass is not None
        base = self.base_pass(x.contiguous(memory_format=torch.channels_last))
        return base.outputs[self.base_pass.graph.output], base

    def features(self, x: Tensor) -> Tensor:
        return self.run_trunk(x)[0]


def _unsuitable(trunk: torch.nn.Module | None) -> str | None:
    """Why a trunk gains nothing from the backend or cannot be run by it."""
    if trunk is None:
        return "it has no accessible feature maps"
    try:
        graph = LocalGraph(trunk)
    except NotLocalError as error:
        return str(error)
    return None if graph.has_dense_3x3 else "it has no 3 x 3 convolution without strides"

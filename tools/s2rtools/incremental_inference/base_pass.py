"""The forward pass of a local graph on unchanged images, in float32.

On the processor, 3 x 3 convolutions use Winograd's algorithm where it saves time, with tiles so
small that its rounding is below that of a sum in float32. Bias, rectifier and pooling that follow a
convolution are computed in one pass over memory, which also writes the input of the next one.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
from torch import Tensor

from s2rtools.common.numba_cache import njit
from s2rtools.incremental_inference.fused_update import RectifiedPool
from s2rtools.incremental_inference.graph import (
    BaseOutputs,
    LocalGraph,
    Operation,
    convolve_directly,
)
from s2rtools.incremental_inference.winograd import KERNEL, WinogradConvolution

ACCURATE_TILES = (2, 3, 4)
"""Sides of output tiles for which the rounding error of Winograd's algorithm is below that of a
direct sum."""


class BasePass:
    """Runs a graph on images and keeps what a recomputation of changed regions reads."""

    def __init__(self, graph: LocalGraph) -> None:
        self.graph = graph
        self.readers = _only_readers(graph)
        self.pools = {
            step.name: pool
            for step in graph.steps
            if step.convolution is not None
            and (pool := RectifiedPool.of(step.convolution.merged)) is not None
        }
        self._winograd = {
            step.name: WinogradConvolution(step.convolution.weight)
            for step in graph.steps
            if step.convolution is not None
            and step.convolution.is_dense
            and step.convolution.weight.shape[2:] == (KERNEL, KERNEL)
        }

    def __call__(self, x: Tensor) -> BaseOutputs:
        """Outputs of every operation for images x (N, C, h, w)."""
        if x.device.type != "cpu":
            return self.graph.compute_base(x, convolve_directly)
        return self.graph.compute_base(x, self.convolve, self._finish)

    def convolve(
        self, step: Operation, x: Tensor, tiles: tuple[int, ...] = ACCURATE_TILES
    ) -> Tensor:
        """A convolution in float32 without padding and bias; `tiles` may be used for it."""
        assert step.convolution is not None
        winograd = self._winograd.get(step.name)
        if winograd is not None and x.device.type == "cpu":
            height, width = (side - KERNEL + 1 for side in x.shape[-2:])
            if (tile := winograd.tile((height, width), tiles)) is not None:
                return winograd(x, tile)
        return convolve_directly(step, x)

    def _finish(self, step: Operation, sums: Tensor) -> tuple[Tensor, Tensor, Tensor | None] | None:
        """Sums with bias, rectified and pooled outputs, and the input of the step that reads them.

        `sums` (N, C, h, w) are changed. None for other operations than a rectifier and a pooling;
        no input where several operations read the outputs.
        """
        pool, part = self.pools.get(step.name), step.convolution
        if pool is None or part is None:
            return None
        biased = sums.permute(0, 2, 3, 1).contiguous()
        count, *sides, channels = biased.shape
        lengths = [
            (side - size) // stride + 1
            for side, size, stride in zip(sides, pool.size, pool.stride, strict=True)
        ]
        outputs = biased.new_empty(count, *lengths, channels)
        reader, margins, target = self.readers.get(step.name), (0, 0), biased.new_empty(0, 0, 0, 0)
        if reader is not None and reader.windows is not None:
            margins = reader.windows[0].padding, reader.windows[1].padding
        if any(margins):
            padded = [n + 2 * margin for n, margin in zip(lengths, margins, strict=True)]
            target = biased.new_empty(count, *padded, channels)
        bias = biased.new_zeros(channels) if part.bias is None else part.bias.detach()
        _rectify_and_pool(
            biased.numpy(), bias.numpy(), pool.size, pool.stride, outputs.numpy(), margins,
            target.numpy(),
        )  # fmt: skip
        second = [t.permute(0, 3, 1, 2) for t in (biased, outputs, target)]
        return second[0], second[1], second[2] if len(target) else None


def _only_readers(graph: LocalGraph) -> dict[str, Operation]:
    """By operation: the convolution that alone reads its output."""
    users = Counter([graph.output, *(name for step in graph.steps for name in step.inputs)])
    return {
        name: step
        for step in graph.steps
        if step.convolution is not None
        for name in step.inputs
        if users[name] == 1
    }


@njit(cache=True, nogil=True)
def _rectify_and_pool(
    sums: Any, bias: Any, pool: Any, stride: Any, outputs: Any, margins: Any, padded: Any
) -> None:
    """Add `bias` to `sums` (N, h, w, C), and fill `outputs` and, unless empty, `padded`."""
    channels = sums.shape[3]
    rows, columns = outputs.shape[1], outputs.shape[2]
    top, left = margins
    for n in range(len(sums)):
        biased = 0
        for y in range(rows + 1):
            until = y * stride[0] + pool[0] if y < rows else sums.shape[1]
            while biased < until:
                for x in range(sums.shape[2]):
                    values = sums[n, biased, x]
                    for k in range(channels):
                        values[k] += bias[k]
                biased += 1
            if y == rows:
                break
            for x in range(columns):
                best = outputs[n, y, x]
                first = sums[n, y * stride[0], x * stride[1]]
                for k in range(channels):
                    best[k] = max(first[k], np.float32(0))
                for i in range(pool[0]):
                    for j in range(pool[1]):
                        values = sums[n, y * stride[0] + i, x * stride[1] + j]
                        for k in range(channels):
                            best[k] = max(best[k], values[k])
        if len(padded) == 0:
            continue
        padded[n, :top] = 0
        padded[n, top + rows :] = 0
        for y in range(rows):
            padded[n, y + top, :left] = 0
            padded[n, y + top, left + columns :] = 0
            for x in range(columns):
                for k in range(channels):
                    padded[n, y + top, x + left, k] = outputs[n, y, x, k]

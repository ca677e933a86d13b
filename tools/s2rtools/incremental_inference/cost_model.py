"""Time of incremental inference relative to full inference, estimated by counting.

A convolution costs its multiply-adds, an operation the elements that it writes, and every call an
overhead. The estimate depends on the network alone, so that all machines choose the same way.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from s2rtools.incremental_inference.graph import LocalGraph, Operation, convolve_directly
from s2rtools.incremental_inference.regions import PixelRegion

ELEMENT = 20.0
"""Multiply-adds that take as long as writing one element. Fitted to measurements on processors."""
CALL = 1e6
"""Multiply-adds that take as long as the overhead of one operation on one batch."""
_FULL_BATCH, _LOCAL_PAIRS = 8, 8
"""Images that are computed at once in full, and contents of a patch that are locally."""


def local_cost(
    graph: LocalGraph, image: tuple[int, int, int], patches: Sequence[PixelRegion]
) -> float:
    """Estimated time of recomputing each patch of an image locally, relative to in full.

    `image` is the shape of the image: channels, rows and columns.
    """
    with torch.inference_mode():
        base = graph.compute_base(torch.zeros(1, *image), convolve_directly)
    regions = [graph.affected_regions(patch, base) for patch in patches]
    batches = len({graph.batch_signature(affected) for affected in regions})
    full = local = 0.0
    for step in graph.steps:
        sums = base.sums.get(step.name, base.outputs[step.name])
        output = base.outputs[step.name]
        inputs = sum(base.outputs[name].shape[1] for name in step.inputs)
        whole = _cost(step, (output.shape[-2], output.shape[-1]), sums.shape[1])
        full += len(patches) * (whole + CALL / _FULL_BATCH)
        for affected in regions:
            shape = affected[step.name].shape
            local += _cost(step, shape, sums.shape[1]) + ELEMENT * inputs * _read(step, shape)
        local += batches * CALL * 2 / _LOCAL_PAIRS
    return local / full


def _cost(step: Operation, shape: tuple[int, int], channels: int) -> float:
    """Cost of computing outputs of a region's shape, in multiply-adds."""
    positions = float(shape[0] * shape[1])
    part = step.convolution
    if part is None or step.windows is None:
        return ELEMENT * channels * positions
    for window, stride in zip(step.windows, part.strides, strict=True):
        positions *= window.stride / stride
    return positions * (part.weight.numel() + ELEMENT * channels)


def _read(step: Operation, shape: tuple[int, int]) -> float:
    """Positions of the input from which outputs of a region's shape are computed."""
    if step.windows is None:
        return float(shape[0] * shape[1])
    rows, cols = (w.required_inputs(0, n)[1] for w, n in zip(step.windows, shape, strict=True))
    return float(max(rows, 0) * max(cols, 0))

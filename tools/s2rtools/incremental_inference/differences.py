"""Incremental recomputation of a network by differences from the unchanged image.

A convolution of changed values is that of the unchanged ones plus the convolution of their
difference, which is zero outside the affected region. Only the difference is convolved, so a
reduced precision rounds the difference and not the values: its error is relative to the effect of
the change. Sums, activations and pooling stay in float32. On the processor, 3 x 3 convolutions in
float32 use Winograd's algorithm where it saves time: its rounding, too, is relative to the effect.
A rectifier and a pooling that follow a convolution are computed with its sums in one pass
(`fused_update`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

from s2rtools.incremental_inference.base_pass import BasePass
from s2rtools.incremental_inference.fused_update import Placement, update
from s2rtools.incremental_inference.graph import BaseOutputs, LocalGraph, Operation
from s2rtools.incremental_inference.regions import PixelRegion
from s2rtools.incremental_inference.winograd import TILES

SHARES = {"float32": 2.0, "bfloat16": 0.25, "bfloat16-broad": 0.1}
"""By precision of differences: the share of a network's multiply-adds from which one of its
convolutions is computed in bfloat16."""

Regions = Sequence[dict[str, PixelRegion]]


class DifferenceGraph:
    """A `LocalGraph` that is recomputed by differences, large convolutions in reduced precision."""

    def __init__(self, graph: LocalGraph | BasePass, precision: str) -> None:
        """`precision` is one of `SHARES`. The base may be computed by a given pass."""
        self._pass = graph if isinstance(graph, BasePass) else BasePass(graph)
        self.graph, self._share = self._pass.graph, SHARES[precision]
        self._weights: dict[str, Tensor] = {}
        self._packed: dict[str, Tensor] = {}

    def compute_base(self, x: Tensor) -> BaseOutputs:
        """Run the trunk on unchanged images in float32, as the base of later calls."""
        return self._pass(x)

    def _converted_weights(self, base: BaseOutputs) -> dict[str, Tensor]:
        """The weights of every convolution in the precision in which it is computed."""
        parts = {s.name: s.convolution for s in self.graph.steps if s.convolution is not None}
        additions = {
            name: part.weight.numel() * base.sums[name][0, 0].numel()
            for name, part in parts.items()
        }
        limit = self._share * sum(additions.values())
        return {
            name: part.weight.to(torch.bfloat16 if additions[name] >= limit else torch.float32)
            for name, part in parts.items()
        }

    def recompute(self, base: BaseOutputs, differences: Tensor, regions: Regions) -> Tensor:
        """The difference of the output for several patches of equal signature.

        `differences` (N, P, M, C, h, w): for each of N base images and P places, M changes of the
        patch. Returns (N, P, M, C', h', w') at `regions[p][graph.output]`.
        """
        if not self._weights:
            self._weights = self._converted_weights(base)
        lead = differences.shape[:3]
        parts = {self.graph.input: differences.flatten(0, 2)}
        canvases: dict[str, Tensor] = {}
        for step in self.graph.steps:
            if regions[0][step.name].empty:
                channels = base.outputs[step.name].shape[1]
                parts[step.name] = differences.new_empty((len(differences), channels, 0, 0))
                continue
            if step.convolution is not None:
                canvas = canvases.pop(step.name, None)
                if canvas is None:
                    name, dtype = step.inputs[0], self._weights[step.name].dtype
                    canvas = self._canvas(step, name, parts[name], regions, dtype)
                change = self._linear(step, canvas, self._weights[step.name])
                reader = self._pass.readers.get(step.name)
                if step.name not in self._pass.pools or differences.device.type != "cpu":
                    parts[step.name] = self._minus_base(step, change, base, regions, lead)
                elif reader is None or regions[0][reader.name].empty:
                    parts[step.name] = self._update(step, change, base, regions)
                else:
                    canvases[reader.name] = self._update(step, change, base, regions, reader)
            elif step.kind in ("add", "concatenate"):
                inputs = [self._canvas(step, name, parts[name], regions) for name in step.inputs]
                parts[step.name] = step.call(*inputs)
            else:
                parts[step.name] = self._pointwise(step, base, parts, regions, lead)
        return parts[self.graph.output].unflatten(0, lead)

    def _update(
        self, step: Operation, change: Tensor, base: BaseOutputs, regions: Regions,
        reader: Operation | None = None,
    ) -> Tensor:  # fmt: skip
        """The difference of a step's output, for `reader` with the zeros around it that it reads.

        `change` (N P M, C, h, w) is the difference of the convolution.
        """
        part, size, offset = step.convolution, regions[0][step.name].shape, (0, 0)
        assert part is not None
        assert step.windows is not None
        shape, dtype = size, torch.float32
        if reader is not None:
            offset = self.graph.offset(reader, regions[0], step.name)
            shape, dtype = _input_size(reader, regions), self._weights[reader.name].dtype
        rows, cols = (w.stride // s for w, s in zip(step.windows, part.strides, strict=True))
        corners = [(r[step.name].r0, r[step.name].c0) for r in regions]
        starts = np.array([(r * rows, c * cols, r, c) for r, c in corners], dtype=np.int64)
        target = torch.empty(len(change), *shape, change.shape[1], dtype=dtype)
        update(
            change, base.sums[step.name], base.outputs[step.name], self._pass.pools[step.name],
            Placement(starts, size, offset), _channels_second(target),
        )  # fmt: skip
        return _channels_second(target)

    def _minus_base(
        self, step: Operation, change: Tensor, base: BaseOutputs, regions: Regions,
        lead: tuple[int, ...],
    ) -> Tensor:  # fmt: skip
        """Like `_update` without a reader, for any operations merged into the convolution."""
        part = step.convolution
        assert part is not None
        assert step.windows is not None
        strides = [w.stride // s for w, s in zip(step.windows, part.strides, strict=True)]
        height, width = change.shape[-2:]
        corners = [(r[step.name].r0 * strides[0], r[step.name].c0 * strides[1]) for r in regions]
        needed = [PixelRegion(r, r + height, c, c + width) for r, c in corners]
        changed = _rows_last(change.float()).unflatten(0, lead)
        changed = changed + _crops(base.sums[step.name], needed)[:, :, None]
        after = part.after(_channels_second(changed.flatten(0, 2)))
        return _minus(after, base.outputs[step.name], [r[step.name] for r in regions], lead)

    def _linear(self, step: Operation, x: Tensor, weight: Tensor) -> Tensor:
        """A convolution without padding and bias, in the precision of `weight`."""
        assert step.convolution is not None
        if weight.dtype == torch.float32:
            return self._pass.convolve(step, x, TILES)
        if x.device.type == "cpu" and _can_pack():
            return self._packed_convolution(step, x, weight)
        return step.convolution.linear(x, weight)

    def _packed_convolution(self, step: Operation, x: Tensor, weight: Tensor) -> Tensor:
        """A convolution whose weights are brought into the order of oneDNN once."""
        assert step.convolution is not None
        options = step.convolution.linear.keywords
        how = [0, 0], options["stride"], options["dilation"], options["groups"]
        if step.name not in self._packed:
            self._packed[step.name] = torch.ops.mkldnn._reorder_convolution_weight(
                weight, *how, list(x.shape)
            )
        convolved: Tensor = torch.ops.mkldnn._convolution_pointwise(
            x, self._packed[step.name], None, *how, "none", [], ""
        )
        return convolved

    def _pointwise(
        self, step: Operation, base: BaseOutputs, parts: dict[str, Tensor], regions: Regions,
        lead: tuple[int, ...],
    ) -> Tensor:  # fmt: skip
        """Steps without a linear part: their output for the changed values minus the unchanged."""
        name = step.inputs[0]
        canvas = self._canvas(step, name, parts[name], regions)
        if step.windows is None:
            source, needed = base.outputs[name], [region[step.name] for region in regions]
        else:
            rows, cols = step.windows
            source = base.padded[step.name]
            needed = [
                PixelRegion(*rows.required_inputs(r.r0, r.r1), *cols.required_inputs(r.c0, r.c1))
                for r in (region[step.name] for region in regions)
            ]
        changed = _rows_last(canvas).unflatten(0, lead) + _crops(source, needed)[:, :, None]
        after = step.call(_channels_second(changed.flatten(0, 2)))
        return _minus(after, base.outputs[step.name], [r[step.name] for r in regions], lead)

    def _canvas(
        self, step: Operation, name: str, part: Tensor, regions: Regions,
        dtype: torch.dtype = torch.float32,
    ) -> Tensor:  # fmt: skip
        """An input's difference with the zeros around it that the step reads."""
        row, col = self.graph.offset(step, regions[0], name)
        size = _input_size(step, regions)
        if (row, col, *size) == (0, 0, *part.shape[-2:]) and dtype == part.dtype:
            return part
        canvas = _channels_second(
            torch.zeros(len(part), *size, part.shape[1], dtype=dtype, device=part.device)
        )
        top, left = max(row, 0), max(col, 0)
        pasted = part[..., top - row : size[0] - row, left - col : size[1] - col]
        canvas[..., top : top + pasted.shape[-2], left : left + pasted.shape[-1]] = pasted
        return canvas


def _input_size(step: Operation, regions: Regions) -> tuple[int, int]:
    """Rows and columns that a step reads to compute its regions."""
    size = regions[0][step.name].shape
    if step.windows is None:
        return size
    rows, cols = (
        window.required_inputs(0, length) for window, length in zip(step.windows, size, strict=True)
    )
    return rows[1], cols[1]


@cache
def _can_pack() -> bool:
    """Whether oneDNN convolves in bfloat16 on this processor."""
    return torch.backends.mkldnn.is_available() and bool(
        torch.ops.mkldnn._is_mkldnn_bf16_supported()
    )


def _rows_last(x: Tensor) -> Tensor:
    """(B, C, h, w) as (B, h, w, C), contiguous."""
    return x.permute(0, 2, 3, 1).contiguous()


def _channels_second(x: Tensor) -> Tensor:
    """(B, h, w, C) as (B, C, h, w) with the channels last in memory."""
    return x.permute(0, 3, 1, 2)


def _crops(x: Tensor, regions: Sequence[PixelRegion]) -> Tensor:
    """Regions of equal size of x (N, C, H, W), as (N, P, h, w, C)."""
    rows_last: Any = x.permute(0, 2, 3, 1)
    return torch.stack([rows_last[:, r.r0 : r.r1, r.c0 : r.c1] for r in regions], dim=1)


def _minus(
    changed: Tensor, base: Tensor, regions: Sequence[PixelRegion], lead: tuple[int, ...]
) -> Tensor:
    """Changed outputs (N P M, C, h, w) minus the unchanged ones of their regions."""
    grouped = _rows_last(changed).unflatten(0, lead)
    return _channels_second((grouped - _crops(base, regions)[:, :, None]).flatten(0, 2))

"""A trunk as a graph of local operations, and its incremental recomputation.

Supported operations are pointwise operations, sliding windows (convolution, pooling with a fixed
window) and joins (add, channel concatenation). For these, a changed region of the input affects a
known region of the output, and only that is recomputed; the unchanged surroundings come from one
pass over the unchanged image. Exact up to the order of float additions.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor, fx, nn
from torch.fx.proxy import TraceError
from torch.nn import functional

from s2rtools.incremental_inference.regions import PixelRegion, SlidingWindow, affected_region

_POINTWISE = (
    nn.ReLU, nn.ReLU6, nn.LeakyReLU, nn.ELU, nn.SiLU, nn.GELU, nn.Hardswish, nn.Sigmoid, nn.Tanh,
    nn.Dropout, nn.Dropout2d, nn.Identity, nn.BatchNorm2d,
)  # fmt: skip
_POINTWISE_FUNCTIONS = (
    functional.relu, torch.relu, functional.leaky_relu, functional.silu, functional.gelu,
    torch.sigmoid, torch.tanh,
)  # fmt: skip
_ADD = (operator.add, operator.iadd, torch.add)
_CAT = (torch.cat, torch.concat)
_WINDOWS = (nn.Conv2d, nn.MaxPool2d, nn.AvgPool2d)

Pair = tuple[int, int]


def non_local_reason(trunk: nn.Module) -> str | None:
    """Why a trunk cannot be recomputed incrementally; None if it can."""
    try:
        LocalGraph(trunk)
    except NotLocalError as error:
        return str(error)
    return None


class NotLocalError(ValueError):
    """The trunk contains an operation whose output depends on the whole image."""


@dataclass(frozen=True, slots=True)
class _Operation:
    """One operation: the names of its inputs and the function that computes it."""

    name: str
    inputs: tuple[str, ...]
    kind: str
    call: Any
    rows: SlidingWindow | None = None
    cols: SlidingWindow | None = None
    fill: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class BaseOutputs:
    """Outputs of every operation for the unchanged images (N, C, h, w), and padded copies."""

    outputs: dict[str, Tensor]
    padded: dict[str, Tensor]


class LocalGraph:
    """A traced trunk in evaluation mode for incremental recomputation."""

    def __init__(self, trunk: nn.Module) -> None:
        """Raises NotLocalError naming the operation that is not local."""
        try:
            traced = trunk if isinstance(trunk, fx.GraphModule) else fx.symbolic_trace(trunk)
        except (TraceError, TypeError, RuntimeError) as error:
            raise NotLocalError(f"torch.fx cannot trace it: {error}") from error
        if trunk.training:
            raise NotLocalError("it is in training mode")
        modules = dict(traced.named_modules())
        self._steps: list[_Operation] = []
        self._input = last = ""
        for node in traced.graph.nodes:
            if node.op == "placeholder":
                if self._input:
                    raise NotLocalError("it has more than one input")
                self._input = node.name
            elif node.op == "output":
                last = _output_name(node)
            else:
                self._steps.append(_operation(node, modules))
        self._steps, self.output = _fuse_operations(self._steps, last)

    def compute_base(self, x: Tensor) -> BaseOutputs:
        """Run the trunk on unchanged images, as the base of later calls."""
        outputs = {self._input: x}
        padded: dict[str, Tensor] = {}
        for step in self._steps:
            values = [outputs[name] for name in step.inputs]
            if step.rows is None or step.cols is None:
                outputs[step.name] = _join(step, values)
            else:
                padded[step.name] = _pad(values[0], step)
                outputs[step.name] = step.call(padded[step.name])
        return BaseOutputs(outputs, padded)

    def affected_regions(self, region: PixelRegion, base: BaseOutputs) -> dict[str, PixelRegion]:
        """For every operation, the output region that a changed input region affects."""
        affected = {self._input: region}
        for step in self._steps:
            merged = affected[step.inputs[0]]
            for name in step.inputs[1:]:
                merged = merged.union(affected[name])
            if step.rows is not None and step.cols is not None:
                shape = base.outputs[step.inputs[0]].shape
                merged = affected_region(merged, step.rows, step.cols, (shape[-2], shape[-1]))
            affected[step.name] = merged
        return affected

    def batch_signature(self, regions: dict[str, PixelRegion]) -> tuple[Any, ...]:
        """A key that is equal for patches that can be computed in one batch."""
        parts: list[Any] = [regions[self._input].shape]
        for step in self._steps:
            parts.append(regions[step.name].shape)
            parts.extend(self._offset(step, regions, name) for name in step.inputs)
        return tuple(parts)

    def _offset(self, step: _Operation, regions: dict[str, PixelRegion], name: str) -> Pair:
        """Offset of an input's changed part in the crop from which the step is computed."""
        target, source = regions[step.name], regions[name]
        if step.rows is None or step.cols is None:
            return source.r0 - target.r0, source.c0 - target.c0
        return (
            source.r0 + step.rows.padding - target.r0 * step.rows.stride,
            source.c0 + step.cols.padding - target.c0 * step.cols.stride,
        )

    def recompute(
        self, base: BaseOutputs, patches: Tensor, regions: Sequence[dict[str, PixelRegion]]
    ) -> Tensor:
        """The changed part of the output for several patches of equal signature.

        `patches` (N, P, M, C, h, w): for each of N base images and P places, M new contents of
        the patch. Returns (N, P, M, C', h', w') at `regions[p][self.output]`.
        """
        lead = patches.shape[:3]
        parts = {self._input: patches.flatten(0, 2)}
        for step in self._steps:
            if regions[0][step.name].empty:
                channels = base.outputs[step.name].shape[1]
                parts[step.name] = patches.new_empty((math.prod(lead), channels, 0, 0))
                continue
            crops = [
                self._paste_changed_part(base, parts[name], step, name, regions, lead)
                for name in step.inputs
            ]
            parts[step.name] = step.call(crops[0]) if step.rows else _join(step, crops)
        return parts[self.output].unflatten(0, lead)

    def _paste_changed_part(
        self,
        base: BaseOutputs,
        part: Tensor,
        step: _Operation,
        name: str,
        regions: Sequence[dict[str, PixelRegion]],
        lead: tuple[int, ...],
    ) -> Tensor:
        target = regions[0][step.name]
        row, col = self._offset(step, regions[0], name)
        if step.rows is None or step.cols is None:
            if part.shape[-2:] == target.shape:
                return part
            source = base.outputs[name]
            windows = [regions[p][step.name] for p in range(len(regions))]
        else:
            source = base.padded[step.name]
            windows = [_required_region(step, regions[p][step.name]) for p in range(len(regions))]
        size = (source.shape[1], *windows[0].shape)
        crop = torch.empty((math.prod(lead), *size), dtype=part.dtype, device=part.device,
                           memory_format=torch.channels_last)  # fmt: skip
        grouped = crop.unflatten(0, lead)
        for place, w in enumerate(windows):
            grouped[:, place] = source[:, None, :, w.r0 : w.r1, w.c0 : w.c1]
        top, left = max(row, 0), max(col, 0)
        pasted = part[..., top - row : crop.shape[-2] - row, left - col : crop.shape[-1] - col]
        crop[..., top : top + pasted.shape[-2], left : left + pasted.shape[-1]] = pasted
        return crop


def _fuse_operations(steps: list[_Operation], output: str) -> tuple[list[_Operation], str]:
    """Merge pointwise steps and unpadded pooling into the window that alone feeds them.

    Merged steps are computed on the window's crop and need no crop of their own. Returns the steps
    and the name of the last step.
    """
    users: dict[str, int] = {output: 1}
    for step in steps:
        for name in step.inputs:
            users[name] = users.get(name, 0) + 1
    fused: dict[str, _Operation] = {}
    renamed: dict[str, str] = {}
    for step in steps:
        inputs = tuple(renamed.get(name, name) for name in step.inputs)
        before = fused.get(inputs[0])
        alone = users[step.inputs[0]] == 1 and step.inputs[0] != output
        if before is not None and before.rows is not None and alone and _is_mergeable(step):
            renamed[step.name] = before.name
            fused[before.name] = _merge_operations(before, step)
        else:
            fused[step.name] = replace(step, inputs=inputs)
    return list(fused.values()), renamed.get(output, output)


def _is_mergeable(step: _Operation) -> bool:
    if step.rows is None or step.cols is None:
        return step.kind == "pointwise"
    return step.kind == "pool" and not (step.rows.padding or step.cols.padding)


def _merge_operations(before: _Operation, step: _Operation) -> _Operation:
    first, then = before.call, step.call
    rows, cols = before.rows, before.cols
    if step.rows is not None and step.cols is not None and rows is not None and cols is not None:
        rows, cols = rows.followed_by(step.rows), cols.followed_by(step.cols)
    return replace(before, rows=rows, cols=cols, call=lambda x: then(first(x)))


def _required_region(step: _Operation, target: PixelRegion) -> PixelRegion:
    if step.rows is None or step.cols is None:
        return target
    return PixelRegion(
        *step.rows.required_inputs(target.r0, target.r1),
        *step.cols.required_inputs(target.c0, target.c1),
    )


def _output_name(node: fx.Node) -> str:
    if len(node.args) != 1 or not isinstance(node.args[0], fx.Node):
        raise NotLocalError("it returns more than one tensor")
    return node.args[0].name


def _operation(node: fx.Node, modules: dict[str, nn.Module]) -> _Operation:
    if node.op == "call_module":
        module = modules[str(node.target)]
        inputs = tuple(_input_names(node))
        if isinstance(module, nn.BatchNorm2d) and module.running_mean is None:
            raise NotLocalError(f"{node.target}: batch norm without running statistics")
        if isinstance(module, _POINTWISE):
            return _Operation(node.name, inputs, "pointwise", _out_of_place(module))
        if isinstance(module, _WINDOWS):
            return _window_operation(node.name, inputs, module)
        raise NotLocalError(f"{node.target} ({type(module).__name__}) is not local")
    if node.op == "call_function":
        if node.target in _POINTWISE_FUNCTIONS:
            options = {k: v for k, v in node.kwargs.items() if k != "inplace"}
            function = node.target
            return _Operation(node.name, tuple(_input_names(node)), "pointwise",
                         lambda x, f=function, o=options: f(x, **o))  # fmt: skip
        if node.target in _ADD and len(_input_names(node)) == 2 and not node.kwargs:
            return _Operation(node.name, tuple(_input_names(node)), "add", torch.add)
        if node.target in _CAT and node.kwargs.get("dim", (*node.args, 0)[1]) == 1:
            return _Operation(node.name, tuple(_input_names(node)), "cat", torch.cat)
    raise NotLocalError(f"{node.name} ({node.target}) is not local")


def _input_names(node: fx.Node) -> list[str]:
    """Names of all input tensors of a step, in order, with repetitions."""
    names: list[str] = []
    for argument in (*node.args, *node.kwargs.values()):
        listed = argument if isinstance(argument, list | tuple) else [argument]
        names += [item.name for item in listed if isinstance(item, fx.Node)]
    return names


def _out_of_place(module: nn.Module) -> nn.Module:
    if getattr(module, "inplace", False):
        module.inplace = False  # type: ignore[assignment]
    return module


def _pair(value: int | Pair) -> Pair:
    return (value, value) if isinstance(value, int) else (int(value[0]), int(value[1]))


def _window_operation(name: str, inputs: tuple[str, ...], module: nn.Module) -> _Operation:
    padding_value = getattr(module, "padding", 0)
    if isinstance(padding_value, str) or getattr(module, "padding_mode", "zeros") != "zeros":
        raise NotLocalError(f"{name}: padding {padding_value!r} is not supported")
    if getattr(module, "divisor_override", None) is not None:
        raise NotLocalError(f"{name}: divisor_override is not supported")
    if getattr(module, "ceil_mode", False):
        raise NotLocalError(f"{name}: ceil_mode is not supported")
    kernel, padding = _pair(module.kernel_size), _pair(padding_value)  # type: ignore[arg-type]
    stride = _pair(module.stride)  # type: ignore[arg-type]
    dilation = _pair(getattr(module, "dilation", 1))
    windows = [
        SlidingWindow(d * (k - 1) + 1, s, p)
        for k, s, p, d in zip(kernel, stride, padding, dilation, strict=True)
    ]
    if isinstance(module, nn.Conv2d):
        weight, bias, groups = module.weight, module.bias, module.groups

        def convolve(x: Tensor) -> Tensor:
            return functional.conv2d(x, weight, bias, stride, 0, dilation, groups)

        return _Operation(name, inputs, "window", convolve, windows[0], windows[1])
    if isinstance(module, nn.MaxPool2d):

        def largest(x: Tensor) -> Tensor:
            return functional.max_pool2d(x, kernel, stride, 0, dilation)

        return _Operation(name, inputs, "pool", largest, windows[0], windows[1], -math.inf)
    if any(padding) and not module.count_include_pad:
        raise NotLocalError(f"{name}: average pooling that excludes its padding")

    def average(x: Tensor) -> Tensor:
        return functional.avg_pool2d(x, kernel, stride)

    return _Operation(name, inputs, "pool", average, windows[0], windows[1])


def _pad(x: Tensor, step: _Operation) -> Tensor:
    rows, cols = step.rows, step.cols
    if rows is None or cols is None or not (rows.padding or cols.padding):
        return x
    edges = (cols.padding, cols.padding, rows.padding, rows.padding)
    return functional.pad(x, edges, value=step.fill).contiguous(memory_format=torch.channels_last)


def _join(step: _Operation, values: list[Tensor]) -> Tensor:
    if step.kind == "cat":
        return torch.cat(values, dim=1)
    return step.call(*values)

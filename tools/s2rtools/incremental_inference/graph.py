"""A trunk as a graph of local operations, for its incremental recomputation.

Supported operations are pointwise operations, sliding windows (convolution, pooling with a fixed
window) and joins (add, channel concatenation). For these, a changed region of the input affects a
known region of the output, and only that is recomputed; the unchanged surroundings come from one
pass over the unchanged image. Exact up to the order of float additions.
"""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
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


@dataclass(frozen=True, slots=True, eq=False)
class Convolution:
    """The linear part of an operation and what follows: `after(linear(x, weight) + bias)`.

    `linear` slides with the given strides along rows and columns, without padding. `is_dense` tells
    that it takes every value of all channels: strides of 1, no dilation, one group. `merged` are
    the functions of which `after` consists.
    """

    linear: partial[Tensor]
    weight: Tensor
    bias: Tensor | None
    strides: Pair
    after: Callable[[Tensor], Tensor]
    is_dense: bool
    merged: tuple[Callable[..., Tensor], ...] = ()


@dataclass(frozen=True, slots=True)
class Operation:
    """One operation: its kind, the names of its inputs and the function that computes it.

    `windows` slide along rows and columns of the input, which is padded with `fill`. `convolution`
    is the same as `call`, with its linear part apart.
    """

    name: str
    inputs: tuple[str, ...]
    kind: str
    call: Callable[..., Tensor]
    windows: tuple[SlidingWindow, SlidingWindow] | None = None
    fill: float = 0.0
    convolution: Convolution | None = None


@dataclass(frozen=True, slots=True, eq=False)
class BaseOutputs:
    """Outputs of every operation for the unchanged images (N, C, h, w), and padded copies.

    `sums` are the outputs of the convolutions with bias, before the operations merged into them.
    """

    outputs: dict[str, Tensor]
    padded: dict[str, Tensor]
    sums: dict[str, Tensor]

    def images(self, rows: slice) -> BaseOutputs:
        """The outputs for some of the images."""
        kept = ({k: v[rows] for k, v in d.items()} for d in (self.outputs, self.padded, self.sums))
        return BaseOutputs(*kept)


Convolve = Callable[[Operation, Tensor], Tensor]
"""Convolution of an operation's padded input (N, C, h, w), without bias."""
Finish = Callable[[Operation, Tensor], tuple[Tensor, Tensor, Tensor | None] | None]
"""From a convolution without bias: with bias; the operation's output; the padded input of the one
operation that reads it, if there is one. None where it does not know the merged operations."""


def convolve_directly(step: Operation, x: Tensor) -> Tensor:
    """The convolution of an operation by its own function."""
    assert step.convolution is not None
    return step.convolution.linear(x, step.convolution.weight)


def _finish_separately(step: Operation, sums: Tensor) -> tuple[Tensor, Tensor, None]:
    """Bias, then the operations merged into the convolution one after the other."""
    part = step.convolution
    assert part is not None
    if part.bias is not None:
        sums = sums + part.bias[:, None, None]
    return sums, part.after(sums), None


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
        self._steps: list[Operation] = []
        self._input = last = ""
        for node in traced.graph.nodes:
            if node.op == "placeholder":
                if self._input:
                    raise NotLocalError("it has more than one input")
                self._input = node.name
            elif node.op == "output":
                if len(node.args) != 1 or not isinstance(node.args[0], fx.Node):
                    raise NotLocalError("it returns more than one tensor")
                last = node.args[0].name
            else:
                self._steps.append(_operation(node, modules))
        self._steps, self.output = _fuse_operations(self._steps, last)

    @property
    def steps(self) -> tuple[Operation, ...]:
        """The operations in the order of computation."""
        return tuple(self._steps)

    @property
    def has_dense_3x3(self) -> bool:
        """Whether a convolution could use `winograd.WinogradConvolution`."""
        parts = (step.convolution for step in self._steps if step.convolution is not None)
        return any(part.is_dense and part.weight.shape[2:] == (3, 3) for part in parts)

    @property
    def input(self) -> str:
        """Name under which the input image stands among the outputs of operations."""
        return self._input

    def compute_base(
        self, x: Tensor, convolve: Convolve, finish: Finish = _finish_separately
    ) -> BaseOutputs:
        """Run the trunk on unchanged images, as the base of later calls.

        `convolve` computes the convolutions without bias, `finish` what follows them.
        """
        outputs = {self._input: x}
        padded: dict[str, Tensor] = {}
        kept: dict[str, Tensor] = {}
        ready: dict[str, Tensor] = {}
        for step in self._steps:
            values = [outputs[name] for name in step.inputs]
            if step.windows is not None:
                if step.inputs[0] in ready:
                    values = [ready[step.inputs[0]]]
                else:
                    values = [_pad(values[0], *step.windows, step.fill)]
                padded[step.name] = values[0]
            if step.convolution is not None:
                result = convolve(step, values[0])
                finished = finish(step, result) or _finish_separately(step, result)
                kept[step.name], outputs[step.name], following = finished
                if following is not None:
                    ready[step.name] = following
            else:
                outputs[step.name] = step.call(*values)
        return BaseOutputs(outputs, padded, kept)

    def affected_regions(self, region: PixelRegion, base: BaseOutputs) -> dict[str, PixelRegion]:
        """For every operation, the output region that a changed input region affects."""
        affected = {self._input: region}
        for step in self._steps:
            merged = affected[step.inputs[0]]
            for name in step.inputs[1:]:
                merged = merged.union(affected[name])
            if step.windows is not None:
                height, width = base.outputs[step.inputs[0]].shape[-2:]
                merged = affected_region(merged, *step.windows, (height, width))
            affected[step.name] = merged
        return affected

    def batch_signature(self, regions: dict[str, PixelRegion]) -> tuple[Any, ...]:
        """A key that is equal for patches that can be computed in one batch."""
        parts: list[Any] = [regions[self._input].shape]
        for step in self._steps:
            parts.append(regions[step.name].shape)
            parts.extend(self.offset(step, regions, name) for name in step.inputs)
        return tuple(parts)

    def offset(self, step: Operation, regions: dict[str, PixelRegion], name: str) -> Pair:
        """Offset of an input's changed part in the crop from which the step is computed."""
        target, source = regions[step.name], regions[name]
        if step.windows is None:
            return source.r0 - target.r0, source.c0 - target.c0
        rows, cols = step.windows
        return (
            source.r0 + rows.padding - target.r0 * rows.stride,
            source.c0 + cols.padding - target.c0 * cols.stride,
        )


def _fuse_operations(steps: list[Operation], output: str) -> tuple[list[Operation], str]:
    """Merge pointwise steps and unpadded pooling into the window that alone feeds them.

    Merged steps are computed on the window's crop, not on separate crops. Returns the steps
    and the name of the last step.
    """
    users = Counter([output, *(name for step in steps for name in step.inputs)])
    fused: dict[str, Operation] = {}
    renamed: dict[str, str] = {}
    for step in steps:
        inputs = tuple(renamed.get(name, name) for name in step.inputs)
        before = fused.get(inputs[0])
        alone = users[step.inputs[0]] == 1 and step.inputs[0] != output
        padded = any(window.padding for window in step.windows or ())
        mergeable = step.kind == "pointwise" or (step.kind == "pool" and not padded)
        if before is not None and before.windows is not None and alone and mergeable:
            rows, cols = before.windows
            if step.windows is not None:
                rows, cols = rows.followed_by(step.windows[0]), cols.followed_by(step.windows[1])
            renamed[step.name] = before.name
            part = before.convolution
            if part is not None:
                after = _composed(part.after, step.call)
                part = replace(part, after=after, merged=(*part.merged, step.call))
            fused[before.name] = replace(
                before, windows=(rows, cols), call=_composed(before.call, step.call),
                convolution=part,
            )  # fmt: skip
        else:
            fused[step.name] = replace(step, inputs=inputs)
    return list(fused.values()), renamed.get(output, output)


def _concatenated(*parts: Tensor) -> Tensor:
    return torch.cat(parts, dim=1)


def _unchanged(x: Tensor) -> Tensor:
    return x


def _composed(first: Callable[..., Tensor], then: Callable[..., Tensor]) -> Callable[..., Tensor]:
    return lambda x: then(first(x))


def _operation(node: fx.Node, modules: dict[str, nn.Module]) -> Operation:
    inputs = tuple(_input_names(node))
    if node.op == "call_module":
        module = modules[str(node.target)]
        if isinstance(module, nn.BatchNorm2d) and module.running_mean is None:
            raise NotLocalError(f"{node.target}: batch norm without running statistics")
        if isinstance(module, _POINTWISE):
            if getattr(module, "inplace", False):
                module.inplace = False
            return Operation(node.name, inputs, "pointwise", module)
        if isinstance(module, _WINDOWS):
            return _window_operation(node.name, inputs, module)
        raise NotLocalError(f"{node.target} ({type(module).__name__}) is not local")
    if node.op == "call_function":
        if node.target in _POINTWISE_FUNCTIONS:
            options = {k: v for k, v in node.kwargs.items() if k != "inplace"}
            return Operation(node.name, inputs, "pointwise", partial(node.target, **options))
        if node.target in _ADD and len(inputs) == 2 and not node.kwargs:
            return Operation(node.name, inputs, "add", torch.add)
        if node.target in _CAT and node.kwargs.get("dim", (*node.args, 0)[1]) == 1:
            return Operation(node.name, inputs, "concatenate", _concatenated)
    raise NotLocalError(f"{node.name} ({node.target}) is not local")


def _input_names(node: fx.Node) -> list[str]:
    """Names of all input tensors of a step, in order, with repetitions."""
    names: list[str] = []
    for argument in (*node.args, *node.kwargs.values()):
        listed = argument if isinstance(argument, list | tuple) else [argument]
        names += [item.name for item in listed if isinstance(item, fx.Node)]
    return names


def _pair(value: int | Pair) -> Pair:
    return (value, value) if isinstance(value, int) else (int(value[0]), int(value[1]))


def _window_operation(name: str, inputs: tuple[str, ...], module: nn.Module) -> Operation:
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
    rows, cols = (
        SlidingWindow(d * (k - 1) + 1, s, p)
        for k, s, p, d in zip(kernel, stride, padding, dilation, strict=True)
    )
    if isinstance(module, nn.Conv2d):
        linear = partial(
            functional.conv2d, stride=stride, padding=0, dilation=dilation, groups=module.groups
        )
        is_dense = (*stride, *dilation, module.groups) == (1, 1, 1, 1, 1)
        part = Convolution(linear, module.weight, module.bias, stride, _unchanged, is_dense)
        convolve = partial(linear, weight=module.weight, bias=module.bias)
        return Operation(name, inputs, "window", convolve, (rows, cols), convolution=part)
    if isinstance(module, nn.MaxPool2d):
        largest = partial(
            functional.max_pool2d, kernel_size=kernel, stride=stride, padding=0, dilation=dilation
        )
        return Operation(name, inputs, "pool", largest, (rows, cols), -math.inf)
    if any(padding) and not module.count_include_pad:
        raise NotLocalError(f"{name}: average pooling that excludes its padding")
    average = partial(functional.avg_pool2d, kernel_size=kernel, stride=stride)
    return Operation(name, inputs, "pool", average, (rows, cols))


def _pad(x: Tensor, rows: SlidingWindow, cols: SlidingWindow, fill: float) -> Tensor:
    if not (rows.padding or cols.padding):
        return x
    edges = (cols.padding, cols.padding, rows.padding, rows.padding)
    return functional.pad(x, edges, value=fill).contiguous(memory_format=torch.channels_last)

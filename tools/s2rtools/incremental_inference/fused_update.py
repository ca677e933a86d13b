"""What follows a convolution of differences, compiled by numba in one pass over memory.

Per changed value: add the unchanged sum, rectify, take the maximum of each pooling window, subtract
the unchanged output, and write the result where the next operation reads it. In torch each of these
steps reads and writes all values.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import torch
from numba import types
from numba.extending import overload
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from s2rtools.common.numba_cache import njit

_RELU = (functional.relu, torch.relu)


@dataclass(frozen=True, slots=True)
class RectifiedPool:
    """A rectifier and a maximum over windows of a size and stride along rows and columns."""

    size: tuple[int, int] = (1, 1)
    stride: tuple[int, int] = (1, 1)

    @classmethod
    def of(cls, calls: tuple[Callable[..., Tensor], ...]) -> RectifiedPool | None:
        """The same as applying `calls` one after the other; None if they are anything else."""
        if not calls or not _is_relu(calls[0]):
            return None
        if len(calls) == 1:
            return cls()
        pool = calls[1]
        if (
            len(calls) > 2
            or not isinstance(pool, partial)
            or pool.func is not functional.max_pool2d
        ):
            return None
        if pool.keywords["dilation"] not in (1, (1, 1)):
            return None
        return cls(pool.keywords["kernel_size"], pool.keywords["stride"])


def _is_relu(call: Callable[..., Tensor]) -> bool:
    return isinstance(call, nn.ReLU) or (
        isinstance(call, partial) and call.func in _RELU and not call.keywords
    )


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where the changed values of P places lie.

    `starts` (P, 4): first row and column of a place in the unchanged sums, and in the unchanged
    outputs. The (rows, columns) of `size` that change are written at `offset` into the target.
    """

    starts: NDArray[np.int64]
    size: tuple[int, int]
    offset: tuple[int, int]


def update(
    change: Tensor,
    sums: Tensor,
    outputs: Tensor,
    pool: RectifiedPool,
    placement: Placement,
    target: Tensor,
) -> None:
    """Fill `target` (B, C, h', w') with the change of a convolution's output, else with zeros.

    `change` (B, C, h, w) is that of its sums; B = N P M counts N images, P places and M contents.
    `sums` and `outputs` (N, C, ., .) are those of the unchanged images. All have the channels last
    in memory. `change` and `target` may be in bfloat16, which is rounded to the nearest.
    """
    modes = len(change) // (len(sums) * len(placement.starts))
    _update(
        _rows(change), _rows(sums), _rows(outputs), placement.starts, modes, pool.size,
        pool.stride, placement.size, placement.offset, _rows(target),
    )  # fmt: skip


def _rows(x: Tensor) -> NDArray[Any]:
    """(B, C, h, w) with the channels last in memory as an array (B, h, w, C), bfloat16 as bits."""
    last = x.permute(0, 2, 3, 1).contiguous()
    array: NDArray[Any] = (last.view(torch.uint16) if x.dtype == torch.bfloat16 else last).numpy()
    return array


def _widen(values: Any, wide: Any, bits: Any) -> None:
    """Copy float32 values, or bits of bfloat16, to float32 `wide`, whose bits are `bits`."""
    raise NotImplementedError("compiled code only")


@overload(_widen)
def _overload_widen(values: Any, wide: Any, bits: Any) -> Callable[..., None]:
    def copy(values: Any, wide: Any, bits: Any) -> None:
        for k in range(len(wide)):
            wide[k] = values[k]

    def shift(values: Any, wide: Any, bits: Any) -> None:
        for k in range(len(wide)):
            bits[k] = np.uint32(values[k]) << np.uint32(16)

    return shift if values.dtype == types.uint16 else copy


def _narrow(wide: Any, bits: Any, values: Any) -> None:
    """Copy float32 `wide`, whose bits are `bits`, to float32 values or to bits of bfloat16."""
    raise NotImplementedError("compiled code only")


@overload(_narrow)
def _overload_narrow(wide: Any, bits: Any, values: Any) -> Callable[..., None]:
    def copy(wide: Any, bits: Any, values: Any) -> None:
        for k in range(len(wide)):
            values[k] = wide[k]

    def to_nearest(wide: Any, bits: Any, values: Any) -> None:
        for k in range(len(wide)):
            low = (bits[k] >> np.uint32(16)) & np.uint32(1)
            values[k] = np.uint16((bits[k] + np.uint32(0x7FFF) + low) >> np.uint32(16))

    return to_nearest if values.dtype == types.uint16 else copy


@njit(cache=True, nogil=True)
def _update(
    change: Any, sums: Any, outputs: Any, starts: Any, modes: int, pool: Any, stride: Any,
    size: Any, offset: Any, target: Any,
) -> None:  # fmt: skip
    places, channels = len(starts), change.shape[3]
    used = ((size[1] - 1) * stride[1] + pool[1]) * channels
    length = size[1] * channels
    start = max(0, offset[1]) * channels
    stop = max(start, min(target.shape[2], offset[1] + size[1]) * channels)
    cut = start - offset[1] * channels
    largest = np.empty(used, np.float32)
    wide = np.empty(max(used, length), np.float32)
    bits = wide.view(np.uint32)
    zero = np.float32(0)
    for b in range(len(change)):
        n, p = b // (places * modes), b // modes % places
        first, begin = starts[p, 1] * channels, starts[p, 3] * channels
        for y in range(target.shape[1]):
            r = y - offset[0]
            if r < 0 or r >= size[0]:
                target[b, y] = 0
                continue
            for i in range(pool[0]):
                row = r * stride[0] + i
                _widen(change[b, row].reshape(-1)[:used], wide[:used], bits[:used])
                unchanged = sums[n, starts[p, 0] + row].reshape(-1)[first : first + used]
                if i == 0:
                    for k in range(used):
                        value = wide[k] + unchanged[k]
                        largest[k] = value if value > zero else zero
                else:
                    for k in range(used):
                        value = wide[k] + unchanged[k]
                        largest[k] = value if value > largest[k] else largest[k]
            before = outputs[n, starts[p, 2] + r].reshape(-1)[begin : begin + length]
            if pool[1] == 1 and stride[1] == 1:
                for k in range(length):
                    wide[k] = largest[k] - before[k]
            else:
                for c in range(size[1]):
                    best = wide[c * channels : (c + 1) * channels]
                    at = c * stride[1] * channels
                    for k in range(channels):
                        best[k] = largest[at + k]
                    for j in range(1, pool[1]):
                        for k in range(channels):
                            value = largest[at + j * channels + k]
                            best[k] = value if value > best[k] else best[k]
                for k in range(length):
                    wide[k] -= before[k]
            filled = target[b, y].reshape(-1)
            filled[:start] = 0
            _narrow(wide[cut : cut + stop - start], bits[cut : cut + stop - start],
                    filled[start:stop])  # fmt: skip
            filled[stop:] = 0

"""The compiled update after a convolution of differences, against the same steps in torch."""

from functools import partial

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from s2rtools.incremental_inference.fused_update import Placement, RectifiedPool, update

IMAGES, MODES, CHANNELS = 2, 3, 5
STARTS = [(0, 0), (1, 2)]
"""First output row and column of each place."""


def channels_last(*shape: int) -> Tensor:
    generator = torch.Generator().manual_seed(sum(shape))
    values = torch.randn(*shape, generator=generator)
    return values.contiguous(memory_format=torch.channels_last)


@pytest.mark.parametrize(
    ("pool", "size"),
    [(RectifiedPool(), (3, 4)), (RectifiedPool((2, 2), (2, 2)), (3, 4)),
     (RectifiedPool((3, 2), (2, 1)), (2, 3))],
)  # fmt: skip
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_update_equals_the_same_steps_in_torch(pool, size, dtype):
    height, width = ((n - 1) * s + k for n, s, k in zip(size, pool.stride, pool.size, strict=True))
    count = IMAGES * len(STARTS) * MODES
    change = channels_last(count, CHANNELS, height, width).to(dtype)
    sums, outputs = channels_last(IMAGES, CHANNELS, 14, 15), channels_last(IMAGES, CHANNELS, 7, 8)
    corners = [(r, c, r * pool.stride[0], c * pool.stride[1]) for r, c in STARTS]
    starts = np.array([(y, x, r, c) for r, c, y, x in corners])
    target = torch.full((count, size[0] + 3, size[1] + 2, CHANNELS), 7.0, dtype=dtype)
    target = target.permute(0, 3, 1, 2)
    update(change, sums, outputs, pool, Placement(starts, size, (2, 1)), target)

    expected = torch.zeros(target.shape)
    for number, (n, p, _) in enumerate(np.ndindex(IMAGES, len(STARTS), MODES)):
        r, c, y, x = corners[p]
        after = torch.relu(change[number].float() + sums[n, :, y : y + height, x : x + width])
        after = functional.max_pool2d(after, pool.size, pool.stride)
        before = outputs[n, :, r : r + size[0], c : c + size[1]]
        expected[number, :, 2 : 2 + size[0], 1 : 1 + size[1]] = after - before
    assert torch.equal(target, expected.to(dtype))


def test_changed_values_outside_of_the_target_are_left_out():
    change, sums = channels_last(1, CHANNELS, 4, 4), channels_last(1, CHANNELS, 4, 4)
    outputs, starts = channels_last(1, CHANNELS, 4, 4), np.zeros((1, 4), dtype=np.int64)
    whole, cut = (torch.empty(1, n, n, CHANNELS).permute(0, 3, 1, 2) for n in (4, 2))
    update(change, sums, outputs, RectifiedPool(), Placement(starts, (4, 4), (0, 0)), whole)
    update(change, sums, outputs, RectifiedPool(), Placement(starts, (4, 4), (-1, -2)), cut)
    assert torch.equal(cut, whole[..., 1:3, 2:4])


def test_only_a_rectifier_and_a_pooling_are_fused():
    pool = partial(
        functional.max_pool2d, kernel_size=(2, 2), stride=(2, 2), padding=0, dilation=(1, 1)
    )
    average = partial(functional.avg_pool2d, kernel_size=(2, 2), stride=(2, 2))
    assert RectifiedPool.of((nn.ReLU(), pool)) == RectifiedPool((2, 2), (2, 2))
    assert RectifiedPool.of((partial(torch.relu),)) == RectifiedPool()
    relu = nn.ReLU()
    for other in ((), (nn.ELU(),), (pool, relu), (relu, average), (relu, pool, pool)):
        assert RectifiedPool.of(other) is None

"""Check by one forward pass that a network takes the input that its contract gives."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import torch
from torch import Tensor, nn

from s2rstore.errors import RequestError
from s2rtools.models.input_contract import Channels, InputContract, InputOverride
from s2rtools.models.preprocessing import preprocess

_SIZES = (
    (224, 224), (256, 256), (128, 128), (64, 64), (32, 32), (96, 96), (192, 192), (299, 299),
    (320, 320), (384, 384), (512, 512), (120, 160), (240, 320), (480, 640), (8, 8), (16, 16),
)  # fmt: skip
"""Usual sizes, tried where a network refuses the size of its contract."""


def output_width(
    network: nn.Module,
    contract: InputContract,
    where: str,
    override: InputOverride | None = None,
) -> int:
    """K of the output (1, K) for one image, or of the first of several outputs.

    Raises RequestError, which begins with `where` and states what the network expects, what the
    contract gives and which key to set in the file of `override`.
    """
    file = str(override.path) if override else "a file for --input"
    try:
        output = _forward(network, contract)
    except Exception as error:  # the module's code may raise anything
        raise RequestError(f"{where}: {_advice(network, contract, file, error)}") from error
    return _checked_width(output, where, file)


def _forward(network: nn.Module, contract: InputContract) -> object:
    """The first output for a made image of the size of the contract."""
    rows, columns = np.indices(contract.size)
    levels = ((rows * 3 + columns * 5) % 256).astype(np.uint8)
    rgb = np.stack([levels, levels[::-1], 255 - levels], axis=-1)
    x = preprocess(rgb[None], levels[None], 10 / 255, contract, levels[None] > 0)
    device = next((each.device for each in network.parameters()), torch.device("cpu"))
    with torch.inference_mode():
        output = network(torch.from_numpy(x).to(device))
    return output[0] if isinstance(output, tuple | list) else output


def _advice(network: nn.Module, contract: InputContract, file: str, error: Exception) -> str:
    fitting = _fitting(network, contract)
    if fitting is None:
        shape = f"(1, {', '.join(map(str, contract.shape))})"
        return (
            f"expected an output for an input of {shape}, got an error: {last_line(error)}; "
            f"set channels or size in {file}"
        )
    expected, got, keys = [], [], []
    if fitting.channels != contract.channels:
        expected.append(f"{fitting.width} channels")
        got.append(f"{contract.width}")
        keys.append(f'channels = "{fitting.channels}"')
    if fitting.size != contract.size:
        expected.append(f"images of {fitting.size[0]} x {fitting.size[1]}")
        got.append(f"{contract.size[0]} x {contract.size[1]}")
        keys.append(f"size = {list(fitting.size)}")
    return (
        f"expected {' and '.join(expected)}, got {' and '.join(got)}; "
        f"set {' and '.join(keys)} in {file}"
    )


def _fitting(network: nn.Module, contract: InputContract) -> InputContract | None:
    """A contract of other channels or of a usual size that the network accepts; None if none."""
    for channels in (contract.channels, *get_args(Channels)):
        for size in (contract.size, *_SIZES):
            candidate = replace(contract, channels=channels, size=size)
            try:
                _forward(network, candidate)
            except Exception:  # networks raise anything for an input that does not fit
                continue
            return candidate
    return None


def _checked_width(output: object, where: str, file: str) -> int:
    is_row = isinstance(output, Tensor) and output.ndim == 2 and len(output) == 1
    if not isinstance(output, Tensor) or not is_row or output.shape[1] not in (3, 4):
        result = str(tuple(output.shape)) if isinstance(output, Tensor) else type(output).__name__
        raise RequestError(
            f"{where}: expected an output of (1, 3) or (1, 4), got {result}; the network must "
            "return x, y and the heading, or its cosine and sine"
        )
    if not output.isfinite().all():
        raise RequestError(
            f"{where}: expected finite numbers, got {output[0].tolist()}; set mean and std, or "
            f"depth_unit, in {file}"
        )
    return int(output.shape[1])


def last_line(error: Exception) -> str:
    """The last line of an exception's message, which names the cause; its type if it is empty."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[-1].strip()[:160] if lines else type(error).__name__

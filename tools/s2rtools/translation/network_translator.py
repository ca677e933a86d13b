"""Translators whose map is a torch network with a working size."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from s2rtools.common.torch_device import device
from s2rtools.translation.colour_statistics import to_uint8
from s2rtools.translation.image_set import Rgb
from s2rtools.translation.method import Settings, Tensors, Translator
from s2rtools.translation.networks import (
    MAX_EDGE,
    MIN_EDGE,
    REDUCTION,
    Generator,
    GeneratorSize,
    check_working_size,
)

_GPU_BATCH = 16
_TIMED_CALLS = 5
_FASTER = 1.2
"""Speed-up from which bfloat16 is used."""
_SLOW = 0.2


def placed(network: nn.Module) -> nn.Module:
    """The network on `device()`; channels last on a GPU only.

    On a processor with AVX-512, training in the default layout took the same time (two images of
    64 x 96: 50 against 45 ms), and translation was faster.
    """
    if device().type == "cuda":
        return network.to(device(), memory_format=torch.channels_last)  # type: ignore[call-overload]
    return network


def to_tensor(rgb: Rgb) -> Tensor:
    """Images (B, h, w, 3) uint8 as (B, 3, h, w) float32 in -1 .. 1 on `device()`."""
    values = torch.from_numpy(np.ascontiguousarray(rgb)).to(device()).permute(0, 3, 1, 2)
    layout = torch.channels_last if device().type == "cuda" else torch.contiguous_format
    return (values.float() / 127.5 - 1).contiguous(memory_format=layout)


def to_grey_levels(x: Tensor) -> NDArray[np.float32]:
    """Grey levels (B, h, w, 3) float32 of a tensor in -1 .. 1."""
    levels: NDArray[np.float32] = ((x.float() + 1) * 127.5).permute(0, 2, 3, 1).cpu().numpy()
    return levels


def check_size(size: Any) -> tuple[int, int]:
    """Rows and columns of a stored working size. Raises ValueError if it is not one."""
    edges = tuple(size) if isinstance(size, list | tuple) else ()
    if len(edges) != 2 or not all(type(e) is int and 1 <= e <= MAX_EDGE for e in edges):
        raise ValueError(f"size {size}: two whole numbers up to {MAX_EDGE}")
    return edges


class NetworkTranslator(Translator):
    """A network of images that was fitted at a working size (rows, columns).

    Images whose longer edge is at most that of the working size pass through the network. Larger
    ones are reduced to that edge, and the upsampled *change* of the network is added to the
    original image, so that its edges stay sharp.
    """

    def __init__(self, network: nn.Module, size: tuple[int, int], network_settings: Settings):
        """`network_settings` are those with which `build` gives an untrained network."""
        self.network = placed(network.eval().requires_grad_(False))
        self.size = size
        self.network_settings = network_settings
        self.precision = torch.float32

    @classmethod
    @abstractmethod
    def build(cls, network_settings: Settings) -> nn.Module:
        """An untrained network. Raises KeyError, TypeError or ValueError for wrong settings."""

    def apply(self, rgb: Rgb) -> Rgb:
        height, width = rgb.shape[1:3]
        scale = max(self.size) / max(height, width)
        if scale >= 1:
            return to_uint8(rgb + self._change(rgb))
        small_size = (max(1, round(height * scale)), max(1, round(width * scale)))
        translated = np.empty_like(rgb)
        for row, image in enumerate(rgb):
            small = cv2.resize(image, small_size[::-1], interpolation=cv2.INTER_AREA)
            change = self._change(small[None])[0]
            large = cv2.resize(change, (width, height), interpolation=cv2.INTER_LINEAR)
            translated[row] = to_uint8(image + large)
        return translated

    def _change(self, rgb: Rgb) -> NDArray[np.float32]:
        """Output minus input (B, h, w, 3) in grey levels, of images of any size.

        A processor takes one image at a time: the result must not depend on the others.
        """
        height, width = rgb.shape[1:3]
        bottom, right = _missing(height), _missing(width)
        batch = _GPU_BATCH if device().type == "cuda" else 1
        change = np.empty(rgb.shape, dtype=np.float32)
        for start in range(0, len(rgb), batch):
            block = rgb[start : start + batch]
            if bottom or right:
                block = np.stack(
                    [
                        cv2.copyMakeBorder(each, 0, bottom, 0, right, cv2.BORDER_REFLECT_101)
                        for each in block
                    ]
                )
            levels = self._output(block)[:, :height, :width]
            change[start : start + batch] = levels - rgb[start : start + batch]
        return change

    def _output(self, rgb: Rgb) -> NDArray[np.float32]:
        """Grey levels of the network's output; both edges fit the network."""
        low = self.precision == torch.bfloat16
        with torch.no_grad(), torch.autocast(device().type, torch.bfloat16, enabled=low):
            return to_grey_levels(self._forward(to_tensor(rgb)))

    def _forward(self, x: Tensor) -> Tensor:
        """The network's output for images (B, 3, h, w) in -1 .. 1."""
        output: Tensor = self.network(x)
        return output

    def use_faster_precision(self, rgb: Rgb) -> None:
        """Use bfloat16 where it is faster and within one grey level in the mean on these images.

        Translators start in float32, whose results differ less between machines. They stay there
        where the first call takes more than `_SLOW` seconds, because comparing takes twelve.
        """
        began = time.perf_counter()
        self.translate(rgb)
        if time.perf_counter() - began > _SLOW:
            return
        results, seconds = {}, {}
        for precision in (torch.float32, torch.bfloat16):
            self.precision = precision
            results[precision] = self.translate(rgb).astype(np.int16)
            times = []
            for _ in range(_TIMED_CALLS):
                began = time.perf_counter()
                self.translate(rgb)
                times.append(time.perf_counter() - began)
            seconds[precision] = min(times)
        full, low = torch.float32, torch.bfloat16
        difference = float(np.abs(results[full] - results[low]).mean())
        faster = seconds[low] * _FASTER < seconds[full]
        self.precision = low if faster and difference < 1 else full

    def tensors(self) -> Tensors:
        state = self.network.state_dict()
        return {name: value.detach().float().cpu().numpy() for name, value in state.items()}

    def settings(self) -> Settings:
        return {"size": list(self.size), "network": self.network_settings}

    @classmethod
    def restore(cls, tensors: Tensors, settings: Settings) -> NetworkTranslator:
        size = check_size(settings["size"])
        # Compared without memory first: settings of a few bytes may declare a huge network.
        with torch.device("meta"):
            declared = cls.build(settings["network"])
        check_tensors(declared, tensors)
        check_working_size(size, full_size_channels(declared))
        network = cls.build(settings["network"])
        state = {name: torch.from_numpy(np.array(v)) for name, v in tensors.items()}
        network.load_state_dict(state)
        return cls(network, size, settings["network"])


class GeneratorTranslator(NetworkTranslator):
    """A `Generator`; base class of the methods that apply one."""

    @classmethod
    def build(cls, network_settings: Settings) -> nn.Module:
        return Generator(GeneratorSize(**network_settings))


def _missing(edge: int) -> int:
    """Pixels to add to an edge so that a network can process it."""
    return max(MIN_EDGE, math.ceil(edge / REDUCTION) * REDUCTION) - edge


def full_size_channels(network: nn.Module) -> int:
    """Channels at the size of the image: those of the first convolution."""
    first = next(layer for layer in network.modules() if isinstance(layer, nn.Conv2d))
    return first.out_channels


def check_tensors(network: nn.Module, tensors: Tensors) -> None:
    """Raise ValueError unless names, shapes and types are those of the network."""
    expected = network.state_dict()
    if set(expected) != set(tensors):
        wrong = sorted(set(expected) ^ set(tensors))
        raise ValueError(f"tensor {wrong[0]} is missing or unknown")
    for name, value in tensors.items():
        if value.shape != tuple(expected[name].shape) or value.dtype.kind != "f":
            raise ValueError(f"tensor {name} is {value.dtype} {value.shape}")

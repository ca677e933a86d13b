"""Reading a weights file that somebody sent: its declarations are judged before its tensors."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from s2rstore.errors import RequestError
from s2rstore.files.input_files import open_regular, read_bytes

MAX_TORCHSCRIPT_BYTES = 1 << 31
"""Bytes of a TorchScript archive, which is only read where it is trusted."""
_MAX_HEADER_BYTES = 16 << 20
"""Bytes of a safetensors header; a tensor takes about 100."""
_COPIES, _BESIDE = 4, 16 << 20
"""A weights file may hold its parameters so many times (as float64, with an optimizer's moments),
and so many bytes beside them."""


def max_file_bytes(parameters: int) -> int:
    """The size that a weights file of so many bytes of parameters may have."""
    return _COPIES * parameters + _BESIDE


def read_weights_file(path: Path, most: int) -> bytes:
    """The content of a weights file whose declared sizes fit the file.

    Raises RequestError for pipes, devices, folders, files of more than `most` bytes, safetensors
    whose header is longer than the file, and archives that are compressed or overlap.
    """
    if path.suffix == ".safetensors":
        with open_regular(path) as file:
            declared = int.from_bytes(file.read(8), "little")
            if declared > min(_MAX_HEADER_BYTES, max(path.stat().st_size - 8, 0)):
                raise RequestError(f"{path}: no safetensors (its header declares {declared} bytes)")
    content = read_bytes(path, most)
    check_archive(path, content)
    return content


def check_archive(path: Path, content: bytes) -> None:
    """Raises RequestError for an archive whose entries are compressed, or larger than itself."""
    if not content.startswith(b"PK"):
        return
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError) as error:
        raise RequestError(f"{path}: a damaged archive ({error}); copy it anew") from error
    if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
        raise RequestError(f"{path}: its entries are compressed, which torch never writes")
    if sum(entry.file_size for entry in entries) > len(content):
        raise RequestError(f"{path}: its entries declare more bytes than the file has")


def check_tensors(state: Mapping[str, Tensor], wanted: Mapping[str, Tensor], where: str) -> None:
    """Raise RequestError for sparse, quantized or complex tensors, and for a wrong data type."""
    for key, value in state.items():
        plain = value.layout == torch.strided and value.device.type == "cpu"
        if not plain or value.is_quantized or value.is_nested or value.is_complex():
            raise RequestError(f"{where}: {key} is no plain tensor (dtype {value.dtype})")
        if key in wanted and value.is_floating_point() != wanted[key].is_floating_point():
            expected = wanted[key].dtype
            raise RequestError(f"{where}: {key} is {value.dtype}, expected {expected}")


def parameter_bytes(state: Mapping[str, Any]) -> int:
    """Bytes of all tensors of a state dict."""
    return sum(value.numel() * value.element_size() for value in state.values())

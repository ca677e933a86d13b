"""Read an untrusted weights file: check its declared sizes, then its tensors; execute no code."""

from __future__ import annotations

import io
import pickle
import re
import struct
import warnings
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safetensors import SafetensorError

from s2rstore.errors import RequestError
from s2rstore.files.input_files import open_regular, read_bytes
from s2rstore.security.memory_limit import bounded_memory

if TYPE_CHECKING:
    from torch import Tensor, nn

MAX_TORCHSCRIPT_BYTES = 1 << 31
"""Bytes of a TorchScript archive, which is read only if the user trusts it."""
_MAX_HEADER_BYTES = 16 << 20
"""Bytes of a safetensors header; a tensor takes about 100."""
_COPIES, _EXTRA_BYTES = 4, 16 << 20
"""Copies of the parameters in a file (float64, optimizer moments), and bytes in addition."""
_UNPICKLING_BYTES = 64 << 20
"""Memory for unpickling, in addition to the tensors."""
_STATE_DICT = "state dict"
_ARCHIVE_ENTRIES = {
    "torch.export": re.compile(r"(.*/)?(models/.*\.json|serialized_exported_program\.(json|pt))"),
    "torchscript": re.compile(r"[^/]+/(constants\.pkl|code/.*)"),
    _STATE_DICT: re.compile(r"[^/]+/data\.pkl"),
}
"""Entries by which a file of torch is recognised, in this order."""
_ARCHIVE_NAMES = {"torchscript": "TorchScript archive", "torch.export": "torch.export archive"}
_WRAPPER_KEYS = ("state_dict", "model", "model_state_dict", "net")
_DECODING_ERRORS = (
    SafetensorError, RuntimeError, EOFError, MemoryError, ValueError, TypeError, LookupError,
    AttributeError, AssertionError, struct.error,
)  # fmt: skip
"""Exceptions of the readers on bytes that are not a file of tensors."""


def max_file_bytes(parameters: int) -> int:
    """Largest weights file for a number of bytes of parameters."""
    return _COPIES * parameters + _EXTRA_BYTES


def read_weights_file(path: Path, max_bytes: int) -> bytes:
    """Content of a weights file whose declared sizes fit the file.

    Raises RequestError for pipes, devices, folders, files larger than `max_bytes`, safetensors
    whose header is longer than the file, and archives that are compressed or overlap.
    """
    if path.suffix == ".safetensors":
        with open_regular(path) as file:
            declared = int.from_bytes(file.read(8), "little")
            if declared > min(_MAX_HEADER_BYTES, max(path.stat().st_size - 8, 0)):
                raise RequestError(
                    f"{path}: not a safetensors file (its header declares {declared} bytes)"
                )
    content = read_bytes(path, max_bytes)
    check_archive(path, content)
    return content


def check_archive(path: Path, content: bytes) -> None:
    """Raises RequestError for an archive that is no state dict, or whose entries are unusable.

    That is, compressed, or larger than itself.
    """
    if not content.startswith(b"PK"):
        return
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError) as error:
        raise RequestError(f"{path}: a damaged archive ({error}); copy it again") from error
    kind = _kind(entry.filename for entry in entries)
    if kind in _ARCHIVE_NAMES:
        raise RequestError(
            f"{path}: a {_ARCHIVE_NAMES[kind]}, not a state dict; add it with --arch {kind} "
            "--trust, which executes its code"
        )
    if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
        raise RequestError(f"{path}: its entries are compressed, which torch never writes")
    if sum(entry.file_size for entry in entries) > len(content):
        raise RequestError(f"{path}: its entries declare more bytes than the file has")


def check_archive_kind(path: Path, content: bytes, architecture: str) -> None:
    """Raise RequestError where a file of torch is recognised as that of another architecture."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            kind = _kind(archive.namelist())
    except (zipfile.BadZipFile, ValueError, NotImplementedError, OSError):
        return
    if kind == _STATE_DICT:
        raise RequestError(
            f"{path}: a state dict, not a {_ARCHIVE_NAMES[architecture]}; name its architecture: "
            "--arch posest, resposenet or module:factory"
        )
    if kind not in (None, architecture):
        raise RequestError(f"{path}: a {_ARCHIVE_NAMES[kind]}; use --arch {kind}")


def _kind(names: Iterable[str]) -> str | None:
    """What the entries of a file of torch make it: a key of `_ARCHIVE_ENTRIES`."""
    listed = list(names)
    for kind, pattern in _ARCHIVE_ENTRIES.items():
        if any(pattern.fullmatch(name) for name in listed):
            return kind
    return None


def read_state(path: Path, content: bytes) -> dict[str, Tensor]:
    """Tensors of a weights file, read without running code from it. Raises RequestError."""
    import torch
    from safetensors.torch import load

    try:
        if path.suffix == ".safetensors":
            loaded: Any = load(content)
        else:
            with bounded_memory(2 * len(content) + _UNPICKLING_BYTES), warnings.catch_warnings():
                warnings.simplefilter("ignore")  # torch warns of files that it then refuses
                loaded = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        match = re.search(r"GLOBAL ([\w.]+)", str(error))
        reason = "not a file of tensors that torch can read without running code"
        if match:
            reason = f"loading it would run code ({match[1]}), which is refused"
        raise RequestError(f"{path}: {reason}; save its state_dict()") from error
    except _DECODING_ERRORS as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise RequestError(f"{path}: not a plain state dict ({reason})") from error
    for wrapper in _WRAPPER_KEYS:
        if isinstance(loaded, Mapping) and isinstance(loaded.get(wrapper), Mapping):
            loaded = loaded[wrapper]
    if not isinstance(loaded, Mapping) or not all(
        isinstance(v, torch.Tensor) for v in loaded.values()
    ):
        raise RequestError(f"{path}: no state dict in it (a mapping of names to tensors)")
    return {str(key).removeprefix("module."): value for key, value in loaded.items()}


def fill(
    network: nn.Module, state: Mapping[str, Tensor], where: str, hint: str,
    ignored: tuple[str, ...] = (),
) -> None:  # fmt: skip
    """Load a state dict from a file named `where` into a network.

    Batch counters may be missing; unknown tensors are left out where their name begins with one of
    `ignored`. Raises RequestError, which ends in `hint` where names or shapes do not fit.
    """
    expected = network.state_dict()
    missing = [k for k in expected if k not in state and not k.endswith("num_batches_tracked")]
    extra = [key for key in state if key not in expected and not key.startswith(ignored)]
    shaped = [k for k, v in state.items() if k in expected and v.shape != expected[k].shape]
    for defect, keys in (("no", missing), ("unknown", extra), ("wrong shape of", shaped)):
        if keys:
            more = f" and {len(keys) - 3} more" if len(keys) > 3 else ""
            raise RequestError(f"{where}: {defect} {', '.join(keys[:3])}{more}; {hint}")
    check_tensors(state, expected, where)
    network.load_state_dict({key: state[key] for key in expected if key in state}, strict=False)


def check_tensors(state: Mapping[str, Tensor], expected: Mapping[str, Tensor], where: str) -> None:
    """Raise RequestError for sparse, quantized or complex tensors, a wrong data type, and values
    that are not finite."""
    import torch

    for key, value in state.items():
        plain = value.layout == torch.strided and value.device.type == "cpu"
        if not plain or value.is_quantized or value.is_nested or value.is_complex():
            raise RequestError(f"{where}: {key} is not a plain tensor (dtype {value.dtype})")
        if key in expected and value.is_floating_point() != expected[key].is_floating_point():
            dtype = expected[key].dtype
            raise RequestError(f"{where}: {key} is {value.dtype}, expected {dtype}")
        if value.is_floating_point() and not value.isfinite().all():
            raise RequestError(f"{where}: {key} contains values that are not finite")


def parameter_bytes(state: Mapping[str, Any]) -> int:
    """Bytes of all tensors of a state dict."""
    return sum(value.numel() * value.element_size() for value in state.values())

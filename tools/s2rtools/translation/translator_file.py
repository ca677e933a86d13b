"""Translator files: tensors as safetensors, with a JSON header that names method and settings."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from msgspec import Meta, Struct, to_builtins
from msgspec.structs import replace
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

import s2rstore
from s2rstore.errors import RequestError, first_line
from s2rstore.files import layout, safe_files
from s2rstore.files.documents import decode_json
from s2rstore.files.input_files import read_bytes
from s2rstore.remote.open_files import open_files
from s2rtools.translation import METHODS
from s2rtools.translation.depth_noise import DepthNoise
from s2rtools.translation.image_set import ImageSet
from s2rtools.translation.method import Translator

HEADER = "translator"
FORMAT = 1
MAX_BYTES = 256 << 20
MAX_VALUE = 1e9
"""Bound of the values of all tensors."""
MAX_FIT_EDGE = 1 << 16
"""Bound of the edges of the images of the fit."""
_DEPTH = "depth_noise/"
_PROBE = np.arange(16 * 16 * 3, dtype=np.uint8).reshape(1, 16, 16, 3)
"""An image that every translator can translate."""
_UNREADABLE = (
    SafetensorError, ValueError, KeyError, TypeError, AttributeError, RecursionError,
)  # fmt: skip
"""Errors that reading the tensors and the header of a file can raise."""
_DAMAGE = (
    KeyError, IndexError, TypeError, ValueError, ArithmeticError, RuntimeError, MemoryError,
    np.linalg.LinAlgError, cv2.error,
)  # fmt: skip
"""Errors of `restore` and of the first image of a damaged translator."""


class Header(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The header of a translator file.

    `source` and `target` are names of domains or folders; `size` is the size of the images of the
    fit, rows and columns. `folders` identifies the files of the folders of the fit, as
    `names_digest`. `lower` is that of the translator.
    """

    format: int
    method: str
    version: int
    source: str
    target: str
    size: tuple[int, int]
    settings: dict[str, Any]
    folders: tuple[str, str] | None = None
    lower: Annotated[float, Meta(gt=0, le=1)] = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class StoredTranslator:
    """A translator as it is stored; `depth_noise` is None where depth passes through.

    `folders` holds the `names_digest` of source and target, None for a fit in a store.
    """

    translator: Translator
    source: str
    target: str
    size: tuple[int, int]
    depth_noise: DepthNoise | None = None
    folders: tuple[str, str] | None = None

    @property
    def method(self) -> str:
        return self.translator.method


def encode(stored: StoredTranslator) -> bytes:
    """Content of the file; equal translators give equal bytes."""
    translator = stored.translator
    version = METHODS[translator.method].version
    header = Header(
        FORMAT, translator.method, version, stored.source, stored.target, stored.size,
        translator.settings(), stored.folders,
    )  # fmt: skip
    if translator.lower < 1:
        header = replace(header, lower=translator.lower)
    tensors = {name: np.asarray(array, order="C") for name, array in translator.tensors().items()}
    if stored.depth_noise is not None:
        noise = stored.depth_noise.tensors()
        tensors |= {_DEPTH + name: np.asarray(array, order="C") for name, array in noise.items()}
    if not tensors:
        tensors = {"empty": np.zeros(1, dtype=np.float32)}
    return save(tensors, {HEADER: json.dumps(to_builtins(header), sort_keys=True)})


def read_translator(path: Path) -> StoredTranslator:
    """The translator of a file. Raises RequestError naming the file if it is not one."""
    return decode(read_bytes(path, MAX_BYTES), str(path))


def load_translator(text: str, store: Path | None = None) -> StoredTranslator:
    """The translator of a file, or of a store by its name. Raises RequestError."""
    path = Path(text)
    if store is None and not path.suffix and not path.exists():
        raise RequestError(f"{text}: no such file; a translator's name needs --store")
    if store is None or path.suffix == ".safetensors":
        return read_translator(path)
    with s2rstore.open(store) as opened:
        sha256 = opened.translator(text).sha256
    return open_stored(store, sha256)


def decode(content: bytes, where: str) -> StoredTranslator:
    """Read a translator from the content of a file; error messages begin with `where`."""
    try:
        tensors = load(content)
        length = int.from_bytes(content[:8], "little")
        metadata = json.loads(content[8 : 8 + length]).get("__metadata__") or {}
        text = metadata[HEADER]
    except _UNREADABLE as error:
        raise RequestError(f"{where}: not a translator file; make one with `s2r translate fit`") \
            from error  # fmt: skip
    header = decode_json(text.encode(), Header, where)
    if header.format != FORMAT:
        raise RequestError(f"{where}: format {header.format}, this version reads {FORMAT}")
    if header.method not in METHODS:
        raise RequestError(f"{where}: method {header.method!r}: one of {', '.join(METHODS)}")
    method = METHODS[header.method]
    if header.version != method.version:
        raise RequestError(
            f"{where}: version {header.version} of {method.name}, this program has "
            f"{method.version}; fit it again"
        )
    if not all(1 <= edge <= MAX_FIT_EDGE for edge in header.size):
        raise RequestError(f"{where}: damaged (size {header.size})")
    for name, array in tensors.items():
        _check_values(array, f"{where}: tensor {name!r}")
    noise = {name.removeprefix(_DEPTH): a for name, a in tensors.items() if name.startswith(_DEPTH)}
    plain = {name: array for name, array in tensors.items() if not name.startswith(_DEPTH)}
    plain.pop("empty", None)
    try:
        translator = method.translator.restore(plain, header.settings)
        translator.lower = header.lower
        depth_noise = DepthNoise.restore(noise) if noise else None
        if translator.quick:
            with np.errstate(invalid="raise", over="raise"):
                translator.translate(_PROBE)
    except _DAMAGE as error:
        reason = first_line(error)[:200]
        raise RequestError(f"{where}: damaged ({type(error).__name__}: {reason})") from error
    return StoredTranslator(
        translator, header.source, header.target, header.size, depth_noise, header.folders
    )


def names_digest(images: ImageSet) -> str:
    """SHA-256 of the names of images, which identifies a folder of images."""
    return hashlib.sha256("\n".join(images.names).encode(errors="surrogateescape")).hexdigest()


def _check_values(array: NDArray[Any], what: str) -> None:
    """Raise RequestError, beginning with `what`, for other values than bounded numbers."""
    if array.dtype.kind not in "fiu":
        raise RequestError(f"{what} is of type {array.dtype}, not floating or integer")
    if array.size and not (array.min() > -MAX_VALUE and array.max() < MAX_VALUE):
        raise RequestError(f"{what} contains values that are not finite or not below {MAX_VALUE:g}")


def stored_path(sha256: str) -> str:
    """Path of a translator's file inside a store."""
    return f"{layout.TRANSLATORS}/{layout.checked_hash(sha256, 'translator')}.safetensors"


@lru_cache(maxsize=8)
def open_stored(root: Path, sha256: str) -> StoredTranslator:
    """The translator of a store by its hash. Raises RequestError if it is missing or damaged."""
    file = stored_path(sha256)
    try:
        content = open_files(root).read(file, MAX_BYTES)
    except OSError as error:
        reason = safe_files.error_text(error)
        raise RequestError(f"{root / file}: cannot be read ({reason}); fit it again") from error
    if hashlib.sha256(content).hexdigest() != sha256:
        raise RequestError(f"{root / file}: damaged (its checksum does not agree); fit it again")
    return decode(content, str(root / file))

"""Embeddings of imported predictions: .npy files of numbers, read row by row."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.input_files import check_regular

MAX_WIDTH = 65_536
"""Numbers of one embedding."""
_STORED = {"float16": "float16", "float32": "float32", "float64": "float32"}
"""The types that are read, and as which they are stored."""
_BLOCK = 4096

Values = NDArray[Any]


def open_embeddings(path: Path) -> Values:
    """The numbers (rows, D) of a file, mapped into memory.

    Raises RequestError where the file holds anything but a table of floating-point numbers. Arrays
    of objects, which would execute code, are not read.
    """
    check_regular(path)
    try:
        values = npy_format.open_memmap(path, mode="r")
    except (ValueError, OSError, EOFError) as error:
        reason = " ".join(str(error).split())
        raise RequestError(f"{path}: not a .npy file of numbers ({reason})") from error
    if values.dtype.name not in _STORED or values.ndim != 2:
        raise RequestError(
            f"{path}: {values.dtype} {values.shape}; expected float16, float32 or float64 of shape "
            "(rows, D)"
        )
    if not 1 <= values.shape[1] <= MAX_WIDTH:
        raise RequestError(f"{path}: {values.shape[1]} columns; expected 1 to {MAX_WIDTH}")
    return values


class InstanceEmbeddings:
    """The embeddings of one side with a row per instance (N, D), gathered from a file when read.

    NaN where an instance has none.
    """

    def __init__(
        self, values: Values, count: int, iids: NDArray[np.int64], rows: NDArray[np.int64]
    ) -> None:
        """The embeddings of `iids` (n,) are `rows` (n,) of `values`; `count` is N."""
        self.shape = count, int(values.shape[1])
        self.dtype = np.dtype(_STORED[values.dtype.name])
        self._values = values
        self._row = np.full(count, -1, dtype=np.int64)
        self._row[iids] = rows

    def __getitem__(self, rows: slice) -> Values:
        """The embeddings of a range of instances."""
        numbers = self._row[rows]
        block = np.full((numbers.size, self.shape[1]), np.nan, dtype=self.dtype)
        known = numbers >= 0
        block[known] = _as_stored(self._values[numbers[known]])
        return block


def check_finite(path: Path, values: Values, rows: NDArray[np.int64]) -> None:
    """Raise RequestError for the first of `rows` (n,) that is not finite as it is stored."""
    in_order = np.sort(rows)
    for start in range(0, in_order.size, _BLOCK):
        part = in_order[start : start + _BLOCK]
        stored = _as_stored(values[part])
        finite = np.isfinite(stored).all(axis=1)
        if not finite.all():
            row = int(part[np.flatnonzero(~finite)[0]])
            raise RequestError(
                f"{path}: row {row} (from 0) is not finite as {stored.dtype}; remove it with its "
                "prediction"
            )


def _as_stored(values: Values) -> Values:
    with np.errstate(over="ignore"):
        return values.astype(_STORED[values.dtype.name])

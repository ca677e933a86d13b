"""Prediction and embedding files of one side or of both, and which rows go together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from s2rstore.errors import RequestError, one_line
from s2rstore.files.input_files import check_regular
from s2rstore.records import SIDES, Side
from s2rtools.prediction_import.file_predictions import FilePredictions

MAX_WIDTH = 65_536
"""Numbers of one embedding."""
_STORED = {"float16": "float16", "float32": "float32", "float64": "float32"}
"""The types that are read, and as which they are stored."""
_BLOCK = 4096
Values = NDArray[Any]


@dataclass(frozen=True, slots=True)
class SidedFile:
    """A file of one side and trajectory; of both sides or all trajectories where None."""

    path: Path
    side: Side | None = None
    trajectory: str | None = None


def parse_file(text: str) -> SidedFile:
    """Parse `FILE`, `SIDE:FILE` or `SIDE/TRAJECTORY:FILE`; the side is `sim` or `real`."""
    prefix, colon, path = text.partition(":")
    name, slash, trajectory = prefix.partition("/")
    for side in SIDES:
        if colon and name == side:
            return SidedFile(Path(path), side, trajectory if slash else None)
    return SidedFile(Path(text))


@dataclass(frozen=True, slots=True)
class PredictionFile:
    """A file of predictions that has been read."""

    file: SidedFile
    predictions: FilePredictions


def read_embeddings(
    embeddings: Sequence[SidedFile], files: Sequence[PredictionFile], count: int
) -> dict[Side, InstanceEmbeddings]:
    """The embeddings of both sides for `count` instances; empty where there are no files.

    The rows of a file are those of the predictions of both sides, or of its side. Raises
    RequestError where they do not go with the predictions.
    """
    if not embeddings:
        return {}
    by_side: dict[Side, InstanceEmbeddings] = {}
    for each in embeddings:
        values = open_embeddings(each.path)
        used: dict[Side, tuple[NDArray[np.int64], NDArray[np.int64]]] = {}
        for code, side in enumerate(SIDES):
            if each.side not in (None, side):
                continue
            if side in by_side:
                raise RequestError(f"--embeddings {each.path}: the {side} side has a file already")
            predictions, rows = _aligned_rows(each, files, side, values)
            chosen = (predictions.sides == code) & np.isfinite(predictions.poses[:, 0])
            used[side] = predictions.iids[chosen], rows[predictions.rows[chosen]]
        check_finite(each.path, values, np.concatenate([numbers for _, numbers in used.values()]))
        for side, (iids, numbers) in used.items():
            by_side[side] = InstanceEmbeddings(values, count, iids, numbers)
    for side in SIDES:
        if side not in by_side:
            raise RequestError(f"--embeddings: none for the {side} side; add {side}:FILE.npy")
    sim, real = by_side["sim"], by_side["real"]
    if (sim.shape, sim.dtype) != (real.shape, real.dtype):
        raise RequestError(
            f"--embeddings: sim has {sim.shape[1]} numbers as {sim.dtype}, real {real.shape[1]} as "
            f"{real.dtype}; both must be alike"
        )
    return by_side


def _aligned_rows(
    embedding: SidedFile, files: Sequence[PredictionFile], side: Side, values: Values
) -> tuple[FilePredictions, NDArray[np.int64]]:
    """The predictions that embeddings go with, and the embedding of each row of their file."""
    option = f"--embeddings {embedding.path}"
    matching = [each for each in files if each.file.side in (None, side)]
    if len(matching) != 1:
        raise RequestError(
            f"{option}: goes with one file of predictions of the {side} side, not {len(matching)}"
        )
    file, predictions = matching[0].file, matching[0].predictions
    if embedding.side is None and (file.side is not None or predictions.row_sides is None):
        raise RequestError(f"{option}: of which side? give a file for each as sim:FILE, real:FILE")
    count, name = len(predictions.table), file.path.name
    rows = np.arange(count)
    if embedding.side != file.side and predictions.row_sides is not None:
        is_side = predictions.row_sides == SIDES.index(side)
        count, rows, name = int(is_side.sum()), np.cumsum(is_side) - 1, f"{name} ({side})"
    if len(values) != count:
        raise RequestError(f"{option}: {len(values)} rows; {name} has {count}")
    return predictions, rows


def open_embeddings(path: Path) -> Values:
    """Map the array (rows, D) of a file into memory.

    Raises RequestError where the file holds anything but a table of floating-point numbers. Arrays
    of objects, which would execute code, are not read.
    """
    check_regular(path)
    try:
        values = npy_format.open_memmap(path, mode="r")
    except (ValueError, OSError, EOFError) as error:
        reason = one_line(error)
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

"""Arrays that are read row by row, whatever files hold the rows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import NotComputedError, RequestError


class RowArray(ABC):
    """An array (rows, ...) for any thread; indexing gives numpy arrays.

    Every read raises RequestError, which names the file, where a shard is missing or damaged.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    attrs: dict[str, str]

    @property
    @abstractmethod
    def path(self) -> Path:
        """The folder of the array, or of its first part."""

    @abstractmethod
    def rows(self, start: int, stop: int) -> NDArray[Any]:
        """Rows [start, stop), which lie within the array."""

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, selection: Any) -> Any:
        """Index as a numpy array; only the rows that the first axis selects are read."""
        first, *rest = selection if isinstance(selection, tuple) else (selection,)
        count = self.shape[0]
        if isinstance(first, slice) and (first.step is None or first.step > 0):
            start, stop, step = first.indices(count)
            first = slice(None, None, step)
        elif isinstance(first, int | np.integer):
            if not -count <= first < count:
                raise IndexError(f"{self.path}: row {first} of {count}")
            start = int(first) % count
            stop, first = start + 1, 0
        else:
            start, stop = 0, count
        return self.rows(start, max(start, stop))[(first, *rest)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self.rows(0, self.shape[0]), dtype=dtype)

    def at(self, rows: Any) -> NDArray[Any]:
        """Rows by their numbers, in this order, or by a mask (N,)."""
        rows = row_numbers(rows)
        values = np.empty((rows.size, *self.shape[1:]), dtype=self.dtype)
        block = rows // self.block_rows
        for number in np.unique(block):
            places = np.flatnonzero(block == number)
            first, last = int(rows[places].min()), int(rows[places].max())
            values[places] = self.rows(first, last + 1)[rows[places] - first]
        return values

    def filled(self) -> NDArray[Any]:
        """All rows of an array of floats, NaN where none is stored."""
        return self.rows(0, self.shape[0])

    @property
    @abstractmethod
    def block_rows(self) -> int:
        """Rows that are best read together."""

    def _check_range(self, start: int, stop: int) -> None:
        if not 0 <= start <= stop <= self.shape[0]:
            raise IndexError(f"{self.path}: rows {start} to {stop} of {self.shape[0]}")


def row_numbers(rows: Any) -> NDArray[np.int64]:
    """Row numbers of numbers, or of a mask (N,)."""
    rows = np.asarray(rows)
    return np.flatnonzero(rows) if rows.dtype == bool else rows.astype(np.int64)


class PartedArray(RowArray):
    """Arrays that hold the values of consecutive instances, as one array of `rows` rows.

    `parts` are arrays with the number of their first row, ascending. Rows that no part holds are
    NaN with `fills_gaps`; without it, reading them raises NotComputedError, which names the first
    such instance and the `label` of the array.
    """

    def __init__(
        self,
        parts: Sequence[tuple[int, RowArray]],
        rows: int,
        label: str,
        fills_gaps: bool = False,
    ) -> None:
        (_, first), *others = parts
        end = 0
        for start, part in parts:
            if start < end or start + part.shape[0] > rows:
                raise RequestError(f"{part.path}: overlaps another part; run `s2r verify`")
            end = start + part.shape[0]
        for _, part in others:
            if (part.shape[1:], part.dtype) != (first.shape[1:], first.dtype):
                raise RequestError(
                    f"{part.path}: {part.dtype} {part.shape[1:]} differs from the first part, "
                    f"{first.dtype} {first.shape[1:]}; run `s2r verify`"
                )
        self.parts = tuple(parts)
        self.shape = (rows, *first.shape[1:])
        self.dtype, self.attrs = first.dtype, first.attrs
        self._label, self._fills_gaps = label, fills_gaps

    @property
    def path(self) -> Path:
        return self.parts[0][1].path

    @property
    def block_rows(self) -> int:
        return self.parts[0][1].block_rows

    def rows(self, start: int, stop: int) -> NDArray[Any]:
        self._check_range(start, stop)
        shape = stop - start, *self.shape[1:]
        if self._fills_gaps:
            values = np.full(shape, np.nan, dtype=self.dtype)
            self._read(values, start, stop)
            return values
        values = np.empty(shape, dtype=self.dtype)
        if self._read(values, start, stop) != stop - start:
            self._refuse(start)
        return values

    def at(self, rows: Any) -> NDArray[Any]:
        rows = row_numbers(rows)
        values = np.empty((rows.size, *self.shape[1:]), dtype=self.dtype)
        missing = np.ones(rows.size, dtype=bool)
        for first, part in self.parts:
            places = np.flatnonzero((rows >= first) & (rows < first + part.shape[0]))
            values[places], missing[places] = part.at(rows[places] - first), False
        if missing.any():
            if not self._fills_gaps:
                self._refuse(int(rows[missing][0]))
            values[missing] = np.nan
        return values

    def _refuse(self, row: int) -> NoReturn:
        raise NotComputedError(
            f"instance {self._first_missing(row)}: {self._label} is not computed; "
            "run `s2r precompute`"
        )

    def _first_missing(self, row: int) -> int:
        """The first row from `row` on that no part holds."""
        for first, part in self.parts:
            if first <= row < first + part.shape[0]:
                row = first + part.shape[0]
        return row

    def filled(self) -> NDArray[Any]:
        values = np.full(self.shape, np.nan, dtype=self.dtype)
        self._read(values, 0, self.shape[0])
        return values

    def _read(self, values: NDArray[Any], start: int, stop: int) -> int:
        """Read the rows [start, stop) that a part holds into `values`; gives their number."""
        count = 0
        for first, part in self.parts:
            low, high = max(start, first), min(stop, first + part.shape[0])
            if low < high:
                values[low - start : high - start] = part.rows(low - first, high - first)
                count += high - low
        return count


def evenly_spaced(rows: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """At most `most` of the rows in order, the first and the last among them."""
    if rows.size <= most:
        return rows
    return rows[np.linspace(0, rows.size - 1, most).round().astype(np.intp)]

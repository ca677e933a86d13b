"""Block characters: a cell of several pixels in two colours, fitted to an image.

A set of symbols divides each cell into the same grid of pixels. Every pixel of a cell has the
cell's foreground or its background colour, and each such pattern has a character.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas.colour import Pixels, Rgb

Symbols = Literal["half", "quadrant", "sextant", "octant"]
Patterns = NDArray[np.intp]
"""Bit i is set where pixel i of the cell, counted row by row, has the foreground colour."""

_CELLS_AT_ONCE = 2048
"""Cells whose partitions are compared at once, so that the sums stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class SymbolSet:
    """The characters of all patterns of `rows` x `columns` pixels.

    characters: (2 ** (rows * columns),) '<U1', at the index of each pattern.
    """

    name: Symbols
    rows: int
    columns: int
    characters: NDArray[np.str_]

    @property
    def pixels(self) -> int:
        """The number of pixels of a cell."""
        return self.rows * self.columns

    @cached_property
    def members(self) -> NDArray[np.float32]:
        """(partitions, pixels): 1 where a pixel is in the foreground.

        Row k is pattern k + 1. The last pixel is always in the background, so that every partition
        of the pixels into two parts occurs once.
        """
        patterns = np.arange(1, 1 << (self.pixels - 1))
        return (patterns[:, None] >> np.arange(self.pixels) & 1).astype(np.float32)

    @cached_property
    def scores(self) -> NDArray[np.float32]:
        """(pixels * pixels, partitions): what a partition explains, per product of two pixels.

        Two parts of n and m pixels with means a and b explain n |a|^2 + m |b|^2 of the squares of
        centred pixels, which is |sum of the first part|^2 (n + m) / (n m).
        """
        members = self.members
        size = members.sum(axis=1)
        weight = self.pixels / (size * (self.pixels - size))
        products = members[:, :, None] * members[:, None, :] * weight[:, None, None]
        return np.ascontiguousarray(products.reshape(len(members), -1).T)


def _sextants() -> str:
    """Unicode 13 has all patterns of 2 x 3 but the four of half and full blocks."""
    known = {0: " ", 21: "▌", 42: "▐", 63: "█"}
    names = iter(range(0x1FB00, 0x1FB3C))
    return "".join(known[p] if p in known else chr(next(names)) for p in range(64))


_OCTANTS_ELSEWHERE = {
    0: 0x20, 1: 0x1CEA8, 2: 0x1CEAB, 3: 0x1FB82, 5: 0x2598, 10: 0x259D, 15: 0x2580, 20: 0x1FBE6,
    40: 0x1FBE7, 63: 0x1FB85, 64: 0x1CEA3, 80: 0x2596, 85: 0x258C, 90: 0x259E, 95: 0x259B,
    128: 0x1CEA0, 160: 0x2597, 165: 0x259A, 170: 0x2590, 175: 0x259C, 192: 0x2582, 240: 0x2584,
    245: 0x2599, 250: 0x259F, 252: 0x2586, 255: 0x2588,
}  # fmt: skip
"""Patterns of 2 x 4 that are encoded outside the block of octants (Unicode 16, U+1CD00)."""


def _octants() -> str:
    names = iter(range(0x1CD00, 0x1CDE6))
    return "".join(
        chr(_OCTANTS_ELSEWHERE[p] if p in _OCTANTS_ELSEWHERE else next(names)) for p in range(256)
    )


def _symbol_set(name: Symbols, rows: int, columns: int, characters: str) -> SymbolSet:
    return SymbolSet(name, rows, columns, np.array(list(characters)))


SYMBOL_SETS: dict[str, SymbolSet] = {
    symbols.name: symbols
    for symbols in (
        _symbol_set("half", 2, 1, " ▀▄█"),
        _symbol_set("quadrant", 2, 2, " ▘▝▀▖▌▞▛▗▚▐▜▄▙▟█"),
        _symbol_set("sextant", 3, 2, _sextants()),
        _symbol_set("octant", 4, 2, _octants()),
    )
}
"""Half and quarter blocks are in almost every font, sextants (Unicode 13) and octants (Unicode 16)
in few."""


def symbol_stripes(symbols: SymbolSet, width: int) -> str:
    """A sample of `width` cells: slanted stripes, which a font without the characters breaks."""
    down, across = np.mgrid[0 : symbols.rows, 0 : width * symbols.columns]
    char, _ = cells_of((across + down) % 5 < 2, symbols)
    return "".join(char[0].tolist())


@lru_cache(1)
def symbol_pixels() -> dict[str, tuple[int, int, int]]:
    """(rows, columns, pattern) of each character of a set; the coarsest set that has it."""
    found: dict[str, tuple[int, int, int]] = {}
    for symbols in SYMBOL_SETS.values():
        for pattern, char in enumerate(symbols.characters.tolist()):
            found.setdefault(char, (symbols.rows, symbols.columns, pattern))
    return found


@lru_cache(1)
def _is_block_code() -> NDArray[np.bool_]:
    """Whether each code point is a block character; the last entry stands for all that follow."""
    codes = [ord(char) for char in symbol_pixels() if char != " "]
    table = np.zeros(max(codes) + 2, dtype=np.bool_)
    table[codes] = True
    return table


def is_block(char: NDArray[np.str_]) -> NDArray[np.bool_]:
    """Where an array '<U1' holds a character of any set, blanks excepted."""
    table = _is_block_code()
    return table[np.minimum(np.ascontiguousarray(char).view(np.uint32), len(table) - 1)]


@dataclass(frozen=True, slots=True, eq=False)
class BlockCells:
    """Cells as characters (h, w) '<U1' with colours (h, w, 3) uint8."""

    char: NDArray[np.str_]
    fg: Pixels
    bg: Pixels


def cells_of(
    mask: NDArray[np.bool_], symbols: SymbolSet
) -> tuple[NDArray[np.str_], NDArray[np.bool_]]:
    """The characters (h, w) of a mask (rows h, columns w), and where they are not blank."""
    bits = 1 << np.arange(symbols.pixels)
    inked = _by_cell(mask.astype(np.uint8)[..., None], symbols)[..., 0]
    patterns = (inked * bits).sum(axis=-1)
    shape = mask.shape[0] // symbols.rows, mask.shape[1] // symbols.columns
    return symbols.characters[patterns].reshape(shape), (patterns > 0).reshape(shape)


def fit_blocks(pixels: Pixels, symbols: SymbolSet, background: Rgb) -> BlockCells:
    """The block characters and colours with the least squared error.

    pixels: (rows h, columns w, 3) of `symbols`. Each cell is divided into the two parts whose mean
    colours leave the least sum of squared differences in sRGB, found by comparing all partitions.
    The part nearer to `background` has the background colour.
    """
    shape = pixels.shape[0] // symbols.rows, pixels.shape[1] // symbols.columns
    cells = _by_cell(pixels, symbols)
    patterns = np.concatenate([
        _best_partitions(cells[start : start + _CELLS_AT_ONCE], symbols)
        for start in range(0, len(cells), _CELLS_AT_ONCE)
    ])  # fmt: skip
    fg, bg = _part_means(cells, symbols.members[patterns - 1])
    distances = [np.square(part.astype(np.int32) - background).sum(axis=1) for part in (fg, bg)]
    swapped = distances[0] < distances[1]
    patterns[swapped] = (1 << symbols.pixels) - 1 - patterns[swapped]
    fg[swapped], bg[swapped] = bg[swapped], fg[swapped]
    patterns[(fg == bg).all(axis=1)] = 0
    char = symbols.characters[patterns]
    return BlockCells(char.reshape(shape), fg.reshape(*shape, 3), bg.reshape(*shape, 3))


def _by_cell(pixels: Pixels, symbols: SymbolSet) -> Pixels:
    """(rows h, columns w, C) to (h * w, pixels of a cell, C)."""
    high, wide = pixels.shape[0] // symbols.rows, pixels.shape[1] // symbols.columns
    parts = pixels[: high * symbols.rows, : wide * symbols.columns].reshape(
        high, symbols.rows, wide, symbols.columns, -1
    )
    return parts.transpose(0, 2, 1, 3, 4).reshape(high * wide, symbols.pixels, -1)


def _best_partitions(cells: Pixels, symbols: SymbolSet) -> Patterns:
    """The pattern (k,) of the best partition of cells (k, pixels, 3)."""
    values = cells.astype(np.float32)
    values -= values.mean(axis=1, keepdims=True)
    products = np.matmul(values, values.transpose(0, 2, 1))
    explained = products.reshape(len(cells), -1) @ symbols.scores
    return np.asarray(explained.argmax(axis=1) + 1, dtype=np.intp)


def _part_means(cells: Pixels, members: NDArray[np.float32]) -> tuple[Pixels, Pixels]:
    """Mean colours (k, 3) of the members and of the others, cells (k, pixels, 3)."""
    values = cells.astype(np.float32)
    size = members.sum(axis=1)[:, None]
    first = np.matmul(members[:, None, :], values)[:, 0]
    second = values.sum(axis=1) - first
    means = first / size, second / (cells.shape[1] - size)
    inner, outer = (np.rint(mean).astype(np.uint8) for mean in means)
    return inner, outer

"""Block characters show cells of two colours exactly, and all others with the least error."""

import unicodedata

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from s2rtui.canvas.block_symbols import (
    SYMBOL_SETS,
    BlockCells,
    cells_of,
    fit_blocks,
    is_block,
    symbol_stripes,
)
from s2rtui.canvas.glyph_masks import glyph_mask

PAGE = (16, 20, 28)
NAMES = sorted(SYMBOL_SETS)


def shown(cells: BlockCells, name: str) -> np.ndarray:
    """The pixels (rows h, columns w, 3) that a terminal shows."""
    symbols = SYMBOL_SETS[name]
    patterns = {char: pattern for pattern, char in enumerate(symbols.characters.tolist())}
    rows = []
    for row in range(cells.char.shape[0]):
        line = []
        for column in range(cells.char.shape[1]):
            bits = patterns[cells.char[row, column]] >> np.arange(symbols.pixels) & 1
            mask = bits.reshape(symbols.rows, symbols.columns, 1)
            line.append(np.where(mask, cells.fg[row, column], cells.bg[row, column]))
        rows.append(np.concatenate(line, axis=1))
    return np.concatenate(rows, axis=0)


def random_cells(name: str, seed: int) -> np.ndarray:
    symbols = SYMBOL_SETS[name]
    shape = (3 * symbols.rows, 4 * symbols.columns, 3)
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


@given(name=st.sampled_from(NAMES), seed=st.integers(0, 10_000), near=st.booleans())
def test_cells_of_two_colours_are_shown_exactly_and_those_of_one_are_blank(name, seed, near):
    symbols, random = SYMBOL_SETS[name], np.random.default_rng(seed)
    first = random.integers(0, 255, (3, 4, 3))
    second = first + 1 if near else random.integers(0, 256, (3, 4, 3))
    inked = random.random((3 * symbols.rows, 4 * symbols.columns, 1)) < 0.5
    whole = [
        np.repeat(np.repeat(part, symbols.rows, 0), symbols.columns, 1) for part in (first, second)
    ]
    pixels = np.where(inked, *whole).astype(np.uint8)
    cells = fit_blocks(pixels, symbols, PAGE)
    assert (shown(cells, name) == pixels).all()
    assert (cells.char[(cells.fg == cells.bg).all(axis=-1)] == " ").all()


@given(name=st.sampled_from(["half", "quadrant", "sextant"]), seed=st.integers(0, 10_000))
def test_no_other_pattern_has_a_smaller_error(name, seed):
    symbols, pixels = SYMBOL_SETS[name], random_cells(name, seed)
    error = np.square(shown(fit_blocks(pixels, symbols, PAGE), name).astype(float) - pixels)
    high, wide = symbols.rows, symbols.columns
    for row, column in np.ndindex(3, 4):
        box = (slice(row * high, (row + 1) * high), slice(column * wide, (column + 1) * wide))
        cell = pixels[box].reshape(-1, 3).astype(float)
        least = np.inf
        for pattern in range(1, 1 << (symbols.pixels - 1)):
            ink = pattern >> np.arange(symbols.pixels) & 1 > 0
            parts = (cell[ink], cell[~ink])
            least = min(least, sum(np.square(part - part.mean(axis=0)).sum() for part in parts))
        assert error[box].sum() <= least + 3 * symbols.pixels  # rounding of the means


@pytest.mark.parametrize("name", NAMES)
def test_every_pattern_has_a_character_of_its_own_one_cell_wide(name):
    characters = SYMBOL_SETS[name].characters.tolist()
    assert len(set(characters)) == len(characters) == 1 << SYMBOL_SETS[name].pixels
    assert all(cell_len(char) == 1 for char in characters)
    blocks = is_block(np.array(characters))
    assert blocks.tolist() == [char != " " for char in characters]


@pytest.mark.parametrize(
    ("name", "prefix"), [("sextant", "BLOCK SEXTANT-"), ("octant", "BLOCK OCTANT-")]
)
def test_patterns_are_those_of_the_characters_names(name, prefix):
    known = 0
    for pattern, char in enumerate(SYMBOL_SETS[name].characters.tolist()):
        title = unicodedata.name(char, "")
        if title.startswith(prefix):
            known += 1
            assert sum(1 << int(digit) - 1 for digit in title.removeprefix(prefix)) == pattern
    assert known in ((60,) if name == "sextant" else (0, 230))  # octants need Unicode 16


def test_octants_of_other_blocks_are_those_of_their_shape():
    octants = SYMBOL_SETS["octant"]
    for pattern, char in enumerate(SYMBOL_SETS["quadrant"].characters.tolist()):
        bits = (pattern >> np.arange(4) & 1).reshape(2, 2).repeat(2, axis=0).ravel()
        assert octants.characters[(bits << np.arange(8)).sum()] == char
    assert octants.characters[[4, 254]].tolist() == ["\U0001cd00", "\U0001cde5"]


@pytest.mark.parametrize("name", NAMES)
def test_screenshots_draw_the_pixels_of_every_character(name):
    symbols = SYMBOL_SETS[name]
    for pattern, char in enumerate(symbols.characters.tolist()[1:], start=1):
        mask = glyph_mask(char, 24, 12)
        assert mask is not None
        parts = mask.reshape(symbols.rows, 24 // symbols.rows, symbols.columns, -1)
        bits = (pattern >> np.arange(symbols.pixels) & 1).reshape(symbols.rows, 1, -1, 1)
        assert (parts == bits).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_mask_becomes_characters(name):
    symbols = SYMBOL_SETS[name]
    mask = np.zeros((2 * symbols.rows, 3 * symbols.columns), dtype=np.bool_)
    mask[symbols.rows :, : symbols.columns] = True
    char, held = cells_of(mask, symbols)
    assert char.tolist() == [[" "] * 3, ["█", " ", " "]]
    assert held.tolist() == [[False] * 3, [True, False, False]]
    assert len(set(symbol_stripes(symbols, 20))) > 2

"""Procedural textures: the colour of a point on a surface, computed without image files.

Every function is compiled into the ray caster. `u` and `v` are metres along a surface; `seed`
distinguishes objects of the same material.
"""

from __future__ import annotations

import math
from enum import IntEnum

from s2rtools.common.numba_cache import njit


class Material(IntEnum):
    """Material of a surface."""

    PAINT = 0
    PLASTER = 1
    WOOD = 2
    BOOKS = 3
    SCREEN = 4
    POSTER = 5
    CARDBOARD = 6
    METAL = 7
    FABRIC = 8
    FOLIAGE = 9
    DOOR = 10
    WINDOW = 11
    WHITEBOARD = 12
    EXTINGUISHER = 13
    LOCKER = 14
    LAMP = 15
    RACK = 16
    CARPET = 17
    PLANKS = 18
    TILES = 19
    LINOLEUM = 20
    CEILING = 21


@njit(cache=True)
def hashed(a: int, b: int, c: int) -> float:
    """Pseudo-random number in [0, 1), a function of three integers."""
    h = (a * 374761393 + b * 668265263 + c * 2147483647 + 1013904223) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 2246822519) & 0xFFFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFFFF) / 16777216.0


@njit(cache=True)
def noise(u: float, v: float, seed: int) -> float:
    """Smooth value noise on the unit lattice, in [0, 1)."""
    iu, iv = math.floor(u), math.floor(v)
    fu, fv = u - iu, v - iv
    fu, fv = fu * fu * (3 - 2 * fu), fv * fv * (3 - 2 * fv)
    a, b = int(iu), int(iv)
    low = hashed(a, b, seed) * (1 - fu) + hashed(a + 1, b, seed) * fu
    high = hashed(a, b + 1, seed) * (1 - fu) + hashed(a + 1, b + 1, seed) * fu
    return low * (1 - fv) + high * fv


@njit(cache=True)
def textured(
    material: int, u: float, v: float, seed: int, top: bool, r: float, g: float, b: float
) -> tuple[float, float, float]:
    """Linear colour of a surface point with base colour (r, g, b)."""
    if material == 1:
        f = 0.95 + 0.05 * noise(u * 6, v * 6, seed) + 0.03 * noise(u * 30, v * 30, seed + 1)
        if not top and v < 0.09:
            f *= 0.45
        return r * f, g * f, b * f
    if material == 2:
        grain = noise(u * 2.0 + seed, v * 26.0, seed)
        f = 0.74 + 0.34 * grain + 0.06 * noise(u * 40, v * 5, seed)
        return r * f, g * f, b * f
    if material == 3:
        return _books(u, v, seed, r, g, b)
    if material == 4:
        return _screen(u, v, seed)
    if material == 5:
        return _poster(u, v, seed, r, g, b)
    if material == 6:
        f = 0.86 + 0.14 * noise(u * 9, v * 30, seed)
        tape = abs(u - math.floor(u / 0.42 + 0.5) * 0.42) < 0.03
        return (0.72 * f, 0.62 * f, 0.42 * f) if tape else (r * f, g * f, b * f)
    if material == 7:
        f = 0.88 + 0.12 * noise(u * 3, v * 60, seed)
        return r * f, g * f, b * f
    if material == 8:
        weave = 0.08 * ((math.floor(u * 60) + math.floor(v * 60)) & 1)
        f = 0.82 + weave + 0.12 * noise(u * 12, v * 12, seed)
        return r * f, g * f, b * f
    if material == 9:
        f = 0.45 + 0.8 * noise(u * 14, v * 14, seed)
        return r * f, g * f, b * f
    if material == 10:
        return _door(u, v, seed, r, g, b)
    if material == 11:
        return _window(u, v, seed, r, g, b)
    if material == 12:
        return _whiteboard(u, v, seed)
    if material == 13:
        if v > 0.42:
            return 0.05, 0.05, 0.06
        if 0.15 < v < 0.30 and abs(u) < 0.05:
            return 0.85, 0.85, 0.8
        return r, g, b
    if material == 14:
        return _locker(u, v, seed, r, g, b)
    if material == 16:
        return _rack(u, v, seed)
    if material == 17:
        tile = (math.floor(u * 2) + math.floor(v * 2)) & 1
        f = 0.80 + 0.10 * tile + 0.20 * (noise(u * 45, v * 45, seed) - 0.5)
        return r * f, g * f, b * f
    if material == 18:
        return _planks(u, v, seed, r, g, b)
    if material == 19:
        return _tiles(u, v, seed, r, g, b)
    if material == 20:
        f = 0.90 + 0.10 * noise(u * 2.5, v * 2.5, seed) + 0.08 * (noise(u * 50, v * 50, 3) - 0.5)
        return r * f, g * f, b * f
    if material == 21:
        du = abs(u / 0.6 - math.floor(u / 0.6 + 0.5))
        dv = abs(v / 0.6 - math.floor(v / 0.6 + 0.5))
        f = 0.72 if du < 0.03 or dv < 0.03 else 0.95 + 0.05 * noise(u * 30, v * 30, 5)
        return r * f, g * f, b * f
    f = 0.96 + 0.04 * noise(u * 10, v * 10, seed)
    return r * f, g * f, b * f


@njit(cache=True)
def _books(
    u: float, v: float, seed: int, r: float, g: float, b: float
) -> tuple[float, float, float]:
    board = v - math.floor(v / 0.36) * 0.36
    if board < 0.03:
        return r * 0.8, g * 0.8, b * 0.8
    shelf = math.floor(v / 0.36)
    at = u / 0.045
    book = math.floor(at)
    if hashed(book // 7, shelf, seed) < 0.16:
        return 0.09, 0.07, 0.05
    height = 0.20 + 0.12 * hashed(book, shelf, seed + 1)
    if board - 0.03 > height:
        return 0.10, 0.08, 0.06
    if at - book < 0.10:
        return 0.06, 0.05, 0.05
    tone = hashed(book, shelf, seed + 2)
    bright = 0.10 + 0.30 * hashed(book, shelf, seed + 3)
    if abs(board - 0.12) < 0.012 and hashed(book, shelf, seed + 4) < 0.4:
        return 0.60, 0.52, 0.36
    return (
        bright * (1.0 + 0.7 * math.cos(6.2832 * tone)),
        bright * (0.9 + 0.6 * math.cos(6.2832 * (tone - 0.33))),
        bright * (0.8 + 0.6 * math.cos(6.2832 * (tone - 0.67))),
    )


@njit(cache=True)
def _screen(u: float, v: float, seed: int) -> tuple[float, float, float]:
    line = math.floor(v * 45)
    column = math.floor(u * 60)
    if hashed(line, seed, 1) < 0.55 and hashed(column, line, seed) < 0.6:
        return 0.55, 0.75, 0.9
    if u > 0.12:
        return 0.10, 0.22 + 0.2 * hashed(seed, 2, 3), 0.35
    return 0.05, 0.07, 0.12


@njit(cache=True)
def _poster(
    u: float, v: float, seed: int, r: float, g: float, b: float
) -> tuple[float, float, float]:
    kind = int(hashed(seed, 11, 5) * 5)
    if abs(u) > 0.39 or v < 0.04 or v > 0.92:
        return 0.10, 0.10, 0.10
    if abs(u) > 0.35 or v < 0.16 or v > 0.88:
        text = 0.06 < v < 0.12 and abs(u) < 0.28 and hashed(int(u * 45 + 90), seed, 9) < 0.7
        return (0.25, 0.25, 0.28) if text else (0.82, 0.81, 0.76)
    tone = 0.75 + 0.25 * noise(u * 9, v * 9, seed)
    other = 0.15 + 0.5 * hashed(seed, 3, 4)
    if kind == 0:
        du, dv = u - 0.2 * hashed(seed, 1, 1) + 0.1, v - 0.55
        on = du * du + dv * dv < 0.02 + 0.03 * hashed(seed, 1, 2)
    elif kind == 1:
        on = (math.floor((u + v) / 0.13) & 1) == 0
    elif kind == 2:
        on = v > 0.35 + 0.3 * noise(u * 6, 0.5, seed)
        if on and v > 0.6 + 0.15 * noise(u * 11, 2.5, seed):
            return 0.55, 0.66, 0.80
    elif kind == 3:
        on = hashed(math.floor(u / 0.12), math.floor(v / 0.12), seed) < 0.45
    else:
        on = abs(u) < 0.10 + 0.14 * noise(0.5, v * 5, seed)
    if on:
        return tone * other * 0.9, tone * (0.6 - 0.5 * other), tone * 0.4 * (1 - other)
    return tone * r, tone * g, tone * b


@njit(cache=True)
def _door(
    u: float, v: float, seed: int, r: float, g: float, b: float
) -> tuple[float, float, float]:
    if 0.98 < v < 1.04 and 0.30 < abs(u) < 0.40:
        return 0.75, 0.73, 0.65
    inset = abs(u) < 0.28 and (0.15 < v < 0.85 or 1.1 < v < 1.9)
    f = (0.82 if inset else 1.0) * (0.85 + 0.15 * noise(u * 3, v * 18, seed))
    return r * f, g * f, b * f


@njit(cache=True)
def _window(
    u: float, v: float, seed: int, r: float, g: float, b: float
) -> tuple[float, float, float]:
    mullion = abs(u - math.floor(u / 0.9 + 0.5) * 0.9) < 0.035
    if mullion or v < 0.05 or v > 1.15 or abs(v - 0.82) < 0.025:
        return 0.42, 0.42, 0.41
    skyline = 0.32 + 0.22 * noise(u * 1.3, 0.0, seed) + 0.05 * noise(u * 9, 0.0, seed + 1)
    if v < skyline:
        lit = 0.22 + 0.12 * noise(u * 12, v * 12, seed)
        return lit * 0.8 * r, lit * g, lit * 0.75 * b
    f = 1.1 + 0.4 * (v - 0.3)
    return r * f, g * f, b * f


@njit(cache=True)
def _whiteboard(u: float, v: float, seed: int) -> tuple[float, float, float]:
    line = math.floor(v / 0.13)
    wave = line * 0.13 + 0.06 + 0.03 * (noise(u * 22, float(line), seed) - 0.5)
    start, length = -0.6 + 0.3 * hashed(line, seed, 1), 0.4 + 0.7 * hashed(line, seed, 2)
    if abs(v - wave) < 0.012 and start < u < start + length and hashed(line, seed, 3) < 0.75:
        if hashed(line, seed, 4) < 0.5:
            return 0.10, 0.15, 0.55
        return 0.6, 0.10, 0.10
    return 0.88, 0.89, 0.90


@njit(cache=True)
def _locker(
    u: float, v: float, seed: int, r: float, g: float, b: float
) -> tuple[float, float, float]:
    at = u / 0.4
    column = math.floor(at)
    edge = at - column
    if edge < 0.03 or abs(v - 0.95) < 0.01:
        return 0.12, 0.12, 0.13
    if 0.80 < edge < 0.88 and (abs(v - 1.15) < 0.05 or abs(v - 0.6) < 0.05):
        return 0.8, 0.8, 0.78
    f = 0.75 + 0.25 * hashed(column, int(v / 0.95), seed)
    return r * f, g * f, b * f


@njit(cache=True)
def _rack(u: float, v: float, seed: int) -> tuple[float, float, float]:
    unit = math.floor(v / 0.09)
    if v - unit * 0.09 < 0.012:
        return 0.02, 0.02, 0.02
    lamp = hashed(math.floor(u / 0.03), unit, seed)
    if lamp < 0.10:
        return (0.1, 0.9, 0.3) if lamp < 0.07 else (0.9, 0.6, 0.1)
    f = 0.06 + 0.06 * hashed(unit, seed, 7)
    return f, f, f * 1.15


@njit(cache=True)
def _planks(
    u: float, v: float, seed: int, r: float, g: float, b: float
) -> tuple[float, float, float]:
    row = math.floor(u / 0.14)
    shifted = v + 1.3 * hashed(row, seed, 1)
    board = math.floor(shifted / 1.3)
    if u / 0.14 - row < 0.04 or shifted / 1.3 - board < 0.006:
        return r * 0.4, g * 0.4, b * 0.4
    f = 0.72 + 0.32 * hashed(row, board, seed) + 0.14 * (noise(u * 45, v * 3, row) - 0.5)
    return r * f, g * f, b * f


@njit(cache=True)
def _tiles(
    u: float, v: float, seed: int, r: float, g: float, b: float
) -> tuple[float, float, float]:
    iu, iv = math.floor(u / 0.4), math.floor(v / 0.4)
    if u / 0.4 - iu < 0.04 or v / 0.4 - iv < 0.04:
        return 0.35, 0.35, 0.34
    dark = ((int(iu) + int(iv)) & 1) * 0.28 * (seed & 1)
    f = 0.93 - dark + 0.07 * hashed(int(iu), int(iv), seed)
    return r * f, g * f, b * f

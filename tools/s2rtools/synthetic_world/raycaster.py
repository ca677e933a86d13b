"""Ray caster, compiled by numba: nearest surface of a ray, its shade, and whole images.

A ray traverses a grid of floor cells and tests the parts of each cell, so that its cost depends
on the furniture that it passes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtools.common.numba_cache import njit, prange
from s2rtools.synthetic_world.materials import noise, textured

_FAR = 1e9

Vector = tuple[float, float, float]


@njit(cache=True)
def _hit_box(
    origin: Vector, direction: Vector, half_x: float, half_y: float, low: float, high: float
) -> tuple[float, int]:
    """Entry distance and the axis of the face: 0 x, 1 y, 2 z; -1 for a miss."""
    near, far, axis = -_FAR, _FAR, -1
    lows, highs = (-half_x, -half_y, low), (half_x, half_y, high)
    for number in range(3):
        o, d, a, b = origin[number], direction[number], lows[number], highs[number]
        if abs(d) < 1e-12:
            if o < a or o > b:
                return _FAR, -1
            continue
        t0, t1 = (a - o) / d, (b - o) / d
        if t0 > t1:
            t0, t1 = t1, t0
        if t0 > near:
            near, axis = t0, number
        far = min(far, t1)
    if near > far or near < 1e-4:
        return _FAR, -1
    return near, axis


@njit(cache=True)
def _hit_pillar(
    origin: Vector, direction: Vector, half_x: float, half_y: float, low: float, high: float
) -> tuple[float, int]:
    """As `_hit_box`; axis 0 is the round side, 2 the top."""
    best, axis = _FAR, -1
    (lx, ly, oz), (kx, ky, dz) = origin, direction
    ox, oy, dx, dy = lx / half_x, ly / half_y, kx / half_x, ky / half_y
    a, b, c = dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - 1.0
    root = b * b - a * c
    if root < 0.0:
        return _FAR, -1
    if a > 1e-12:
        t = (-b - math.sqrt(root)) / a
        z = oz + t * dz
        if t > 1e-4 and low <= z <= high:
            best, axis = t, 0
    if dz < -1e-9:
        t = (high - oz) / dz
        x, y = ox + t * dx, oy + t * dy
        if 1e-4 < t < best and x * x + y * y <= 1.0:
            best, axis = t, 2
    return best, axis


@njit(cache=True)
def _hit_bush(
    origin: Vector,
    direction: Vector,
    half_x: float,
    half_y: float,
    low: float,
    high: float,
    seed: int,
) -> tuple[float, int]:
    """An ellipsoid with random holes between its leaves; axis 3."""
    half_z = 0.5 * (high - low)
    (lx, ly, oz), (kx, ky, dz) = origin, direction
    ox, oy, pz = lx / half_x, ly / half_y, (oz - 0.5 * (low + high)) / half_z
    dx, dy, ez = kx / half_x, ky / half_y, dz / half_z
    a = dx * dx + dy * dy + ez * ez
    b = ox * dx + oy * dy + pz * ez
    root = b * b - a * (ox * ox + oy * oy + pz * pz - 1.0)
    if root < 0.0:
        return _FAR, -1
    width = math.sqrt(root)
    for layer in range(3):
        t = (-b - (1.0 - 0.7 * layer) * width) / a
        if t < 1e-4:
            continue
        x, y, z = lx + t * kx, ly + t * ky, oz + t * dz
        if noise(x * 17.0 + 5.0 * z, y * 17.0 - 3.0 * z + 9.0 * layer, seed) > 0.45:
            return t, 3
    return _FAR, -1


@njit(cache=True)
def _hit_wheel(
    origin: Vector, direction: Vector, half_x: float, low: float, high: float
) -> tuple[float, int]:
    """A tyre with spokes in the plane y = 0; axis 1."""
    (lx, ly, oz), (kx, ky, dz) = origin, direction
    if abs(ky) < 1e-9:
        return _FAR, -1
    t = -ly / ky
    if t < 1e-4:
        return _FAR, -1
    x, z = lx + t * kx, oz + t * dz - 0.5 * (low + high)
    radius = math.sqrt(x * x + z * z)
    if radius > half_x:
        return _FAR, -1
    if radius > half_x - 0.045 or radius < 0.04:
        return t, 1
    turn = math.atan2(z, x) * (10.0 / math.pi)
    if abs(turn - math.floor(turn + 0.5)) * radius < 0.02:
        return t, 1
    return _FAR, -1


@njit(cache=True)
def trace(
    origin: Vector, direction: Vector, ceiling: float, parts: tuple[Any, ...]
) -> tuple[float, int, int]:
    """Distance along the direction, index of the hit part, and its face.

    `parts` are numbers, codes, start, members, cell and cells of a `PackedScene`. Part -1 is the
    floor, -2 the ceiling, -3 no hit.
    """
    (ox, oy, oz), (dx, dy, dz) = origin, direction
    numbers, codes, start, members, cell, cells = parts
    best, part, face = _FAR, -3, 2
    if dz < -1e-9:
        best, part = -oz / dz, -1
    elif dz > 1e-9:
        best, part = (ceiling - oz) / dz, -2
    col, row = math.floor(ox / cell), math.floor(oy / cell)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    delta_x = cell / abs(dx) if abs(dx) > 1e-12 else _FAR
    delta_y = cell / abs(dy) if abs(dy) > 1e-12 else _FAR
    next_x = ((col + (1 if dx > 0 else 0)) * cell - ox) / dx if abs(dx) > 1e-12 else _FAR
    next_y = ((row + (1 if dy > 0 else 0)) * cell - oy) / dy if abs(dy) > 1e-12 else _FAR
    entered = 0.0
    while 0 <= col < cells and 0 <= row < cells and entered < best:
        at = row * cells + col
        for slot in range(start[at], start[at + 1]):
            p = members[slot]
            rx, ry = ox - numbers[p, 0], oy - numbers[p, 1]
            c, s = numbers[p, 2], numbers[p, 3]
            local = rx * c + ry * s, ry * c - rx * s, oz
            ray = dx * c + dy * s, dy * c - dx * s, dz
            hx, hy, low, high = numbers[p, 4], numbers[p, 5], numbers[p, 6], numbers[p, 7]
            shape = codes[p, 0]
            if shape == 0:
                t, axis = _hit_box(local, ray, hx, hy, low, high)
            elif shape == 1:
                t, axis = _hit_pillar(local, ray, hx, hy, low, high)
            elif shape == 2:
                t, axis = _hit_bush(local, ray, hx, hy, low, high, codes[p, 3])
            else:
                t, axis = _hit_wheel(local, ray, hx, low, high)
            if axis >= 0 and t < best:
                best, part, face = t, p, axis
        if next_x < next_y:
            entered = next_x
            next_x += delta_x
            col += step_x
        else:
            entered = next_y
            next_y += delta_y
            row += step_y
    return best, part, face


@njit(cache=True)
def _sampled(field: Any, x: float, y: float, cell: float, channel: int) -> float:
    """Bilinear value of a (rows, cols, channels) field."""
    rows, cols = field.shape[0], field.shape[1]
    fx = min(max(x / cell - 0.5, 0.0), cols - 1.001)
    fy = min(max(y / cell - 0.5, 0.0), rows - 1.001)
    i, j = int(fy), int(fx)
    a, b = fx - j, fy - i
    low = field[i, j, channel] * (1 - a) + field[i, j + 1, channel] * a
    high = field[i + 1, j, channel] * (1 - a) + field[i + 1, j + 1, channel] * a
    return float(low * (1 - b) + high * b)


@njit(cache=True)
def shade(
    origin: Vector, direction: Vector, hit: tuple[float, int, int], parts: tuple[Any, ...],
    surfaces: tuple[Any, ...],
) -> Vector:  # fmt: skip
    """Linear colour at the hit point of a ray; `parts` and `hit` as in `trace`.

    `surfaces` are floor, palette, light and cell: `floor` holds palette rows per cell, `palette`
    (m, 5) material, r, g, b, seed; `light` (rows, cols, 4) is the light that reaches a cell and,
    last, the openness of the floor.
    """
    (ox, oy, oz), (dx, dy, dz), (t, part, face) = origin, direction, hit
    numbers, codes = parts[0], parts[1]
    floor, palette, light, cell = surfaces
    if part == -3:
        return 0.0, 0.0, 0.0
    x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
    nx, ny, facing = 0.0, 0.0, 1.0
    if part == -1:
        rows, cols = floor.shape
        i = min(max(int(y / cell), 0), rows - 1)
        j = min(max(int(x / cell), 0), cols - 1)
        row = floor[i, j]
        tile, seed = int(palette[row, 0]), int(palette[row, 4])
        red, green, blue = palette[row, 1], palette[row, 2], palette[row, 3]
        r, g, b = textured(tile, x, y, seed, True, red, green, blue)
        facing = 0.45 + 0.55 * _sampled(light, x, y, cell, 3)
    elif part == -2:
        r, g, b = textured(21, x, y, 7, True, 0.80, 0.80, 0.79)
        facing = 0.80
    else:
        c, s = numbers[part, 2], numbers[part, 3]
        rx, ry = x - numbers[part, 0], y - numbers[part, 1]
        lx, ly = rx * c + ry * s, ry * c - rx * s
        low, high = numbers[part, 6], numbers[part, 7]
        material = codes[part, 1]
        mx, my, mz = 0.0, 0.0, 0.0
        if codes[part, 0] == 1 and face == 0:
            hx, hy = numbers[part, 4], numbers[part, 5]
            mx, my = lx / (hx * hx), ly / (hy * hy)
            u, v = math.atan2(ly, lx) * hx, z - low
        elif face == 0:
            mx = 1.0 if lx > 0 else -1.0
            u, v = ly, z - low
        elif face == 1:
            my = 1.0 if ly > 0 else -1.0
            u, v = lx, z - low
        elif face == 3:
            mx, my = lx / numbers[part, 4], ly / numbers[part, 5]
            mz = (2 * z - low - high) / (high - low)
            u, v = lx + ly, z
        else:
            mz = 1.0 if dz < 0 else -1.0
            u, v = lx, ly
        scale = 1.0 / math.sqrt(mx * mx + my * my + mz * mz + 1e-12)
        mx, my, mz = mx * scale, my * scale, mz * scale
        nx, ny = mx * c - my * s, mx * s + my * c
        flat = face == 2
        if (material == 4 or material == 5 or material == 12) and face != 1:
            material = 0
        red, green, blue = numbers[part, 8], numbers[part, 9], numbers[part, 10]
        r, g, b = textured(material, u, v, codes[part, 3], flat, red, green, blue)
        if material == 15 or material == 11:
            return r, g, b
        if material == 4:
            return 0.8 * r, 0.8 * g, 0.8 * b
        facing = 0.80 + 0.11 * (0.55 * nx + 0.83 * ny) + 0.17 * mz
        if not flat:
            facing *= 1.0 - 0.38 * math.exp(-z / 0.16)
            facing *= 1.0 - 0.10 * math.exp((z - 2.7) / 0.25)
    lx, ly = x + 0.18 * nx, y + 0.18 * ny
    return (
        r * facing * _sampled(light, lx, ly, cell, 0),
        g * facing * _sampled(light, lx, ly, cell, 1),
        b * facing * _sampled(light, lx, ly, cell, 2),
    )


@njit(cache=True)
def _srgb(value: float) -> int:
    v = value / (1.0 + 0.25 * value) * 1.15
    v = min(max(v, 0.0), 1.0)
    v = 12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055
    return int(v * 255.0 + 0.5)


@njit(cache=True, parallel=True)
def render(
    poses: Any, lens: Any, samples: int, ceiling: float, parts: tuple[Any, ...],
    surfaces: tuple[Any, ...], rgb: Any, depth: Any, identity: Any,
) -> None:  # fmt: skip
    """Fill rgb (n, h, w, 3) uint8, depth (n, h, w) float32 planar metres, identity (n, h, w).

    `poses` (n, 3) are x, y, heading with y down; `lens` (8,) fx, fy, cx, cy, pitch, height,
    forward offset, exposure. Depth and identity are those of the pixel's centre, colour is the
    mean of samples x samples rays.
    """
    count, height, width = depth.shape
    codes = parts[1]
    for row in prange(count * height):
        n, i = row // height, row % height
        cos_a, sin_a = math.cos(poses[n, 2]), math.sin(poses[n, 2])
        ox, oy = poses[n, 0] + lens[6] * cos_a, poses[n, 1] + lens[6] * sin_a
        origin, cos_p, sin_p = (ox, oy, lens[5]), math.cos(lens[4]), math.sin(lens[4])
        for j in range(width):
            red, green, blue = 0.0, 0.0, 0.0
            for sample in range(-1, samples * samples):
                if sample < 0:
                    u, v = j + 0.5, i + 0.5
                else:
                    u = j + (sample % samples + 0.5) / samples
                    v = i + (sample // samples + 0.5) / samples
                right, up = (u - lens[2]) / lens[0], -(v - lens[3]) / lens[1]
                ahead, dz = cos_p - sin_p * up, sin_p + cos_p * up
                dx, dy = ahead * cos_a - right * sin_a, ahead * sin_a + right * cos_a
                hit = trace(origin, (dx, dy, dz), ceiling, parts)
                if sample < 0:
                    depth[n, i, j] = hit[0] if hit[1] > -3 else 0.0
                    identity[n, i, j] = codes[hit[1], 2] if hit[1] >= 0 else 0
                else:
                    r, g, b = shade(origin, (dx, dy, dz), hit, parts, surfaces)
                    red += min(r, 2.0)
                    green += min(g, 2.0)
                    blue += min(b, 2.0)
            share = 1.0 / max(samples * samples, 1)
            rgb[n, i, j, 0] = _srgb(red * share)
            rgb[n, i, j, 1] = _srgb(green * share)
            rgb[n, i, j, 2] = _srgb(blue * share)


@njit(cache=True)
def light_map(lamps: Any, walls: Any, cell: float) -> NDArray[np.float64]:
    """Light of all lamps visible from each cell, (rows, cols, 3).

    `lamps` (k, 6): x, y, height, r, g, b; `walls` (rows, cols) marks opaque cells.
    """
    rows, cols = walls.shape
    out = np.zeros((rows, cols, 3))
    for i in range(rows):
        for j in range(cols):
            x, y = (j + 0.5) * cell, (i + 0.5) * cell
            for k in range(lamps.shape[0]):
                dx, dy = lamps[k, 0] - x, lamps[k, 1] - y
                square = dx * dx + dy * dy
                if square > 49.0:
                    continue
                steps = int(math.sqrt(square) / cell) + 1
                visible = 1.0
                for step in range(2, steps - 1):
                    a = int((y + dy * step / steps) / cell)
                    b = int((x + dx * step / steps) / cell)
                    if walls[a, b]:
                        visible = 0.0
                        break
                strength = visible / (square + lamps[k, 2] * lamps[k, 2])
                for channel in range(3):
                    out[i, j, channel] += strength * lamps[k, 3 + channel]
    return out


@njit(cache=True, parallel=True)
def render_plan(
    pixels: int, metres: float, from_height: float, parts: tuple[Any, ...],
    surfaces: tuple[Any, ...], rgb: Any,
) -> None:  # fmt: skip
    """Fill rgb (pixels, pixels, 3) uint8 with the view from straight above."""
    for i in prange(pixels):
        for j in range(pixels):
            origin = (j + 0.5) * metres / pixels, (i + 0.5) * metres / pixels, from_height
            down = 1e-9, 1e-9, -1.0
            r, g, b = shade(origin, down, trace(origin, down, 10.0, parts), parts, surfaces)
            rgb[i, j, 0], rgb[i, j, 1], rgb[i, j, 2] = _srgb(r), _srgb(g), _srgb(b)

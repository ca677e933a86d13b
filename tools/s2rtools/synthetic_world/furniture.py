"""Pieces of furniture: functions that return the parts of a piece, randomised by a generator.

A piece has its back to a wall: x runs along the wall, y into the room, z up; metres. To add a
piece, write one function and add one line to `FURNITURE`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from s2rtools.synthetic_world.materials import Material
from s2rtools.synthetic_world.scene_geometry import Colour, ScenePart, Shape

Parts = tuple[ScenePart, ...]
Generator = np.random.Generator

WOODS: tuple[Colour, ...] = (
    (0.52, 0.34, 0.18), (0.68, 0.52, 0.33), (0.30, 0.18, 0.10), (0.75, 0.68, 0.56),
)  # fmt: skip
CLOTHS: tuple[Colour, ...] = (
    (0.12, 0.22, 0.45), (0.50, 0.12, 0.12), (0.12, 0.36, 0.22), (0.55, 0.40, 0.10),
    (0.20, 0.20, 0.22), (0.36, 0.16, 0.40), (0.08, 0.38, 0.42),
)  # fmt: skip
GREY: Colour = (0.35, 0.36, 0.38)
DARK: Colour = (0.05, 0.05, 0.06)


@dataclass(frozen=True, slots=True)
class FurniturePiece:
    """Width and depth along the wall, the function that makes it, and whether it hangs."""

    width: float
    depth: float
    make: Callable[[Generator], Parts]
    hangs: bool = False


def block(
    x: float, y: float, width: float, depth: float, low: float, high: float, colour: Colour,
    material: Material = Material.PAINT, seed: int = 0, shape: Shape = Shape.BOX,
    angle: float = 0.0,
) -> ScenePart:  # fmt: skip
    """A part with full instead of half width and depth."""
    return ScenePart(x, y, width / 2, depth / 2, low, high, colour, material, shape, angle, seed)


def _pick(rng: Generator, colours: tuple[Colour, ...]) -> Colour:
    return colours[int(rng.integers(len(colours)))]


def _seed(rng: Generator) -> int:
    return int(rng.integers(1, 10_000))


def vivid_colour(rng: Generator) -> Colour:
    """A random saturated colour."""
    turn, grey = float(rng.random()), float(rng.uniform(0.25, 0.45))
    red, green, blue = (
        grey + 0.75 * grey * math.cos(2 * math.pi * (turn - k / 3)) for k in range(3)
    )
    return red, green, blue


def chair(rng: Generator, x: float, y: float, angle: float) -> Parts:
    cloth = _pick(rng, CLOTHS)
    parts = (
        block(0, 0, 0.48, 0.48, 0.43, 0.50, cloth, Material.FABRIC, 3),
        block(0, 0.22, 0.46, 0.06, 0.50, 0.98, cloth, Material.FABRIC, 4),
        block(0, 0, 0.06, 0.06, 0.06, 0.43, DARK, Material.METAL, shape=Shape.PILLAR),
        block(0, 0, 0.50, 0.50, 0.0, 0.07, DARK, Material.METAL, shape=Shape.PILLAR),
    )
    return tuple(part.transformed(x, y, angle) for part in parts)


def desk(rng: Generator) -> Parts:
    wood, seed = _pick(rng, WOODS), _seed(rng)
    at = float(rng.uniform(-0.25, 0.25))
    return (
        block(0, 0.40, 1.5, 0.75, 0.71, 0.75, wood, Material.WOOD, seed),
        block(-0.70, 0.40, 0.05, 0.70, 0, 0.71, GREY, Material.METAL),
        block(0.70, 0.40, 0.05, 0.70, 0, 0.71, GREY, Material.METAL),
        block(0.48, 0.40, 0.38, 0.60, 0.05, 0.68, GREY, Material.LOCKER, seed),
        block(at, 0.22, 0.60, 0.04, 0.88, 1.24, DARK, Material.SCREEN, seed),
        block(at, 0.20, 0.07, 0.06, 0.75, 0.90, DARK),
        block(at, 0.55, 0.42, 0.14, 0.75, 0.77, (0.6, 0.6, 0.6)),
        block(-0.55, 0.35, 0.14, 0.24, 0.75, 0.75 + 0.25 * float(rng.random()), vivid_colour(rng)),
        *chair(rng, at, 0.80, float(rng.uniform(-0.4, 0.4))),
    )


def shelf(rng: Generator) -> Parts:
    wood, seed = _pick(rng, WOODS), _seed(rng)
    return (
        block(0, 0.16, 1.10, 0.30, 0, 1.95, wood, Material.BOOKS, seed),
        block(0, 0.165, 1.16, 0.33, 1.93, 1.99, wood, Material.WOOD, seed),
        block(-0.57, 0.165, 0.04, 0.33, 0, 1.95, wood, Material.WOOD, seed),
        block(0.57, 0.165, 0.04, 0.33, 0, 1.95, wood, Material.WOOD, seed),
    )


def cabinet(rng: Generator) -> Parts:
    wood, seed = _pick(rng, WOODS), _seed(rng)
    return (
        block(0, 0.24, 0.95, 0.46, 0.06, 1.10, wood, Material.WOOD, seed),
        block(0, 0.475, 0.02, 0.01, 0.10, 1.06, DARK),
        block(0.08, 0.485, 0.02, 0.02, 0.55, 0.70, GREY, Material.METAL),
        block(-0.08, 0.485, 0.02, 0.02, 0.55, 0.70, GREY, Material.METAL),
        block(-0.2, 0.22, 0.22, 0.16, 1.10, 1.38, vivid_colour(rng)),
        block(0.25, 0.24, 0.16, 0.16, 1.10, 1.30, vivid_colour(rng), shape=Shape.PILLAR),
    )


def lockers(rng: Generator) -> Parts:
    colour = _pick(rng, CLOTHS)
    return (block(0, 0.25, 1.60, 0.48, 0.05, 1.90, colour, Material.LOCKER, _seed(rng)),)


def sofa(rng: Generator) -> Parts:
    cloth, seed = _pick(rng, CLOTHS), _seed(rng)
    return (
        block(0, 0.48, 1.90, 0.85, 0.08, 0.42, cloth, Material.FABRIC, seed),
        block(0, 0.14, 1.90, 0.24, 0.42, 0.86, cloth, Material.FABRIC, seed),
        block(-0.86, 0.48, 0.20, 0.85, 0.42, 0.62, cloth, Material.FABRIC, seed),
        block(0.86, 0.48, 0.20, 0.85, 0.42, 0.62, cloth, Material.FABRIC, seed),
        block(-0.45, 0.33, 0.42, 0.16, 0.44, 0.80, vivid_colour(rng), Material.FABRIC, seed + 1),
    )


def plant(rng: Generator) -> Parts:
    pot, tall = vivid_colour(rng), float(rng.uniform(1.1, 1.75))
    green = (0.12 + 0.1 * float(rng.random()), 0.42, 0.10)
    return (
        block(0, 0.28, 0.36, 0.36, 0, 0.38, pot, shape=Shape.PILLAR),
        block(0, 0.28, 0.05, 0.05, 0.38, 0.70, (0.25, 0.16, 0.08), shape=Shape.PILLAR),
        block(0, 0.30, 0.74, 0.58, 0.50, tall, green, Material.FOLIAGE, _seed(rng), Shape.BUSH),
    )


def whiteboard(rng: Generator) -> Parts:
    return (
        block(0, 0.015, 1.80, 0.03, 0.85, 1.95, (0.55, 0.55, 0.56), Material.METAL),
        block(0, 0.035, 1.70, 0.02, 0.90, 1.90, (0.9, 0.9, 0.9), Material.WHITEBOARD, _seed(rng)),
    )


def poster(rng: Generator) -> Parts:
    return (
        block(0, 0.012, 0.84, 0.02, 1.02, 1.98, vivid_colour(rng), Material.POSTER, _seed(rng)),
    )


def extinguisher(rng: Generator) -> Parts:
    red = (0.70, 0.04, 0.03)
    return (
        block(0, 0.12, 0.19, 0.19, 0.45, 0.98, red, Material.EXTINGUISHER, 1, Shape.PILLAR),
        block(0, 0.10, 0.10, 0.08, 0.98, 1.08, DARK),
        block(0, 0.01, 0.34, 0.02, 1.35, 1.69, red),
        block(0, 0.022, 0.12, 0.01, 1.42, 1.62, (0.9, 0.9, 0.88)),
    )


def cartons(rng: Generator) -> Parts:
    brown = (0.50, 0.34, 0.18)
    turn = float(rng.uniform(-0.2, 0.2))
    return (
        block(-0.28, 0.32, 0.52, 0.46, 0, 0.42, brown, Material.CARDBOARD, 1),
        block(0.30, 0.30, 0.50, 0.42, 0, 0.50, brown, Material.CARDBOARD, 2, angle=turn),
        block(-0.22, 0.32, 0.44, 0.40, 0.42, 0.80, brown, Material.CARDBOARD, 3, angle=-turn),
    )


def bicycle(rng: Generator) -> Parts:
    paint = vivid_colour(rng)
    wheels = tuple(
        block(x, 0.22, 0.68, 0.03, 0.0, 0.68, DARK, shape=Shape.WHEEL) for x in (-0.52, 0.52)
    )
    frame = (
        block(0.13, 0.22, 0.72, 0.04, 0.74, 0.79, paint, Material.METAL),
        block(-0.20, 0.22, 0.05, 0.05, 0.30, 0.92, paint, Material.METAL),
        block(0.08, 0.22, 0.60, 0.04, 0.42, 0.46, paint, Material.METAL),
        block(-0.36, 0.22, 0.36, 0.03, 0.32, 0.36, paint, Material.METAL),
        block(0.50, 0.22, 0.05, 0.05, 0.34, 1.02, paint, Material.METAL),
        block(-0.20, 0.22, 0.26, 0.13, 0.92, 0.98, DARK),
        block(0.48, 0.22, 0.05, 0.50, 1.00, 1.04, DARK),
        block(0.0, 0.22, 0.22, 0.05, 0.26, 0.42, GREY, Material.METAL),
    )
    return wheels + frame


def kitchen(rng: Generator) -> Parts:
    wood, seed = _pick(rng, WOODS), _seed(rng)
    return (
        block(0, 0.31, 2.40, 0.60, 0.08, 0.88, (0.80, 0.79, 0.76), Material.LOCKER, seed),
        block(0, 0.32, 2.44, 0.64, 0.88, 0.93, wood, Material.WOOD, seed),
        block(0, 0.18, 2.40, 0.34, 1.50, 2.15, wood, Material.WOOD, seed + 1),
        block(-0.7, 0.35, 0.45, 0.36, 0.93, 1.20, GREY, Material.METAL),
        block(0.4, 0.3, 0.20, 0.20, 0.93, 1.28, vivid_colour(rng), shape=Shape.PILLAR),
    )


def fridge(rng: Generator) -> Parts:
    return (
        block(0, 0.34, 0.70, 0.66, 0, 1.85, (0.78, 0.79, 0.80), Material.METAL),
        block(0.28, 0.685, 0.03, 0.03, 0.9, 1.5, GREY, Material.METAL),
        block(-0.1, 0.68, 0.2, 0.01, 1.2, 1.45, vivid_colour(rng), Material.POSTER, _seed(rng)),
    )


def printer(rng: Generator) -> Parts:
    return (
        block(0, 0.34, 0.72, 0.62, 0, 0.62, (0.62, 0.62, 0.60), Material.LOCKER, 5),
        block(0, 0.34, 0.66, 0.58, 0.62, 1.06, (0.28, 0.28, 0.30)),
        block(0.1, 0.40, 0.42, 0.40, 1.06, 1.10, (0.85, 0.85, 0.83)),
        block(-0.24, 0.60, 0.14, 0.06, 0.95, 1.06, (0.1, 0.4, 0.7)),
    )


def rack(rng: Generator) -> Parts:
    return (
        block(0, 0.42, 0.66, 0.80, 0, 2.05, DARK, Material.RACK, _seed(rng)),
        block(0, 0.42, 0.70, 0.84, 2.05, 2.10, DARK, Material.METAL),
    )


def bin_(rng: Generator) -> Parts:
    return (block(0, 0.2, 0.30, 0.30, 0, 0.55, vivid_colour(rng), shape=Shape.PILLAR),)


def clothes(rng: Generator) -> Parts:
    hooks = (block(0, 0.03, 1.2, 0.04, 1.70, 1.80, _pick(rng, WOODS), Material.WOOD),)
    coats = tuple(
        block(x, 0.12, 0.26, 0.16, 0.85, 1.72, _pick(rng, CLOTHS), Material.FABRIC, _seed(rng))
        for x in (-0.40, -0.02, 0.38)
    )
    return hooks + coats


def table(rng: Generator) -> Parts:
    """A free-standing meeting table with chairs, centred at the origin."""
    wood = _pick(rng, WOODS)
    chairs: Parts = ()
    for x in (-0.55, 0.55):
        chairs += chair(rng, x, 0.52, 0.0) + chair(rng, x, -0.52, math.pi)
    return (
        block(0, 0, 2.0, 0.9, 0.70, 0.75, wood, Material.WOOD, _seed(rng)),
        block(-0.7, 0, 0.10, 0.60, 0, 0.70, GREY, Material.METAL),
        block(0.7, 0, 0.10, 0.60, 0, 0.70, GREY, Material.METAL),
        *chairs,
    )


FURNITURE: dict[str, FurniturePiece] = {
    "desk": FurniturePiece(1.6, 1.1, desk),
    "shelf": FurniturePiece(1.2, 0.35, shelf),
    "cabinet": FurniturePiece(1.0, 0.5, cabinet),
    "lockers": FurniturePiece(1.7, 0.5, lockers),
    "sofa": FurniturePiece(2.0, 0.9, sofa),
    "plant": FurniturePiece(0.8, 0.7, plant),
    "whiteboard": FurniturePiece(1.9, 0.06, whiteboard, hangs=True),
    "poster": FurniturePiece(0.9, 0.05, poster, hangs=True),
    "extinguisher": FurniturePiece(0.4, 0.25, extinguisher, hangs=True),
    "cartons": FurniturePiece(1.15, 0.6, cartons),
    "bicycle": FurniturePiece(1.8, 0.5, bicycle),
    "kitchen": FurniturePiece(2.5, 0.65, kitchen),
    "fridge": FurniturePiece(0.8, 0.7, fridge),
    "printer": FurniturePiece(0.8, 0.7, printer),
    "rack": FurniturePiece(0.75, 0.85, rack),
    "bin": FurniturePiece(0.4, 0.4, bin_),
    "clothes": FurniturePiece(1.3, 0.25, clothes, hangs=True),
}

"""Training recipes that the Sim2RealViz paper compares."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from s2rstore.errors import RequestError
from s2rstore.records import Side
from s2rtools.training.colour_augmentation import vary_colours
from s2rtools.training.depth_noise import DepthNoise

Augmentation = Callable[[Tensor, torch.Generator], Tensor]


@dataclass(frozen=True, slots=True)
class TrainingRecipe:
    """Training data, learning rate and augmentation of a model.

    `learns_from` are the kinds of domains to train on: sim images are split in blocks; of real
    images a trajectory, or half of the only one, is held out for testing.
    `augmentation(shape, seed)` returns the function that changes each batch (B, 4, h, w).
    """

    name: str
    description: str
    learns_from: tuple[Side, ...]
    learning_rate: float
    augmentation: Callable[[tuple[int, int], int], Augmentation]
    needs_start: bool = False


def _no_augmentation(shape: tuple[int, int], seed: int) -> Augmentation:
    return lambda x, generator: x


def _colours(shape: tuple[int, int], seed: int) -> Augmentation:
    return vary_colours


RECIPES: dict[str, TrainingRecipe] = {
    recipe.name: recipe
    for recipe in (
        TrainingRecipe("vanilla", "sim images as they are", ("sim",), 2e-3, _no_augmentation),
        TrainingRecipe(
            "dataaug",
            "sim images with random brightness, contrast, dynamic range and hue",
            ("sim",),
            2e-3,
            _colours,
        ),
        TrainingRecipe(
            "finetune",
            "a trained model, trained on with sim images and real ones of another part, in "
            "random colours",
            ("sim", "real"),
            5e-4,
            _colours,
            needs_start=True,
        ),
        TrainingRecipe(
            "perlin", "sim images with Perlin noise and holes in depth", ("sim",), 2e-3, DepthNoise
        ),
    )
}


def find_recipe(name: str) -> TrainingRecipe:
    """A recipe by name. Raises RequestError for unknown names."""
    if name not in RECIPES:
        raise RequestError(f"recipe {name!r}: one of {', '.join(RECIPES)}")
    return RECIPES[name]

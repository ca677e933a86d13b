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
    needs_translator: bool = False


RECIPES: dict[str, TrainingRecipe] = {
    recipe.name: recipe
    for recipe in (
        TrainingRecipe(
            "vanilla", "sim images as they are", ("sim",), 2e-3,
            lambda shape, seed: lambda x, generator: x,
        ),
        TrainingRecipe(
            "dataaug", "sim images with random brightness, contrast, dynamic range and hue",
            ("sim",), 2e-3, lambda shape, seed: vary_colours,
        ),
        TrainingRecipe(
            "finetune",
            "a trained model, trained further on sim images and on real images of another part, "
            "in random colours",
            ("sim", "real"), 5e-4, lambda shape, seed: vary_colours, needs_start=True,
        ),
        TrainingRecipe(
            "translated", "sim images through a translator from sim to real", ("sim",), 2e-3,
            lambda shape, seed: lambda x, generator: x, needs_translator=True,
        ),
        TrainingRecipe(
            "perlin", "sim images with Perlin noise and holes in depth", ("sim",), 2e-3, DepthNoise
        ),
    )
}  # fmt: skip


def find_recipe(name: str) -> TrainingRecipe:
    """A recipe by name. Raises RequestError for unknown names."""
    if name not in RECIPES:
        raise RequestError(f"recipe {name!r}: one of {', '.join(RECIPES)}")
    return RECIPES[name]

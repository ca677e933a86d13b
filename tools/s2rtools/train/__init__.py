"""Training pose networks on a data set's own frames; `RECIPES` lists the ways to do it."""

from s2rtools.train.frames import DomainFrames, TrainingFrames
from s2rtools.train.loop import Budget, TrainingResult, train
from s2rtools.train.recipes import RECIPES, Recipe

__all__ = [
    "RECIPES",
    "Budget",
    "DomainFrames",
    "Recipe",
    "TrainingFrames",
    "TrainingResult",
    "train",
]

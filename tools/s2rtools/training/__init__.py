"""Training pose networks on a data set's own frames; `RECIPES` lists the ways to do it."""

from s2rtools.training.recipes import RECIPES, TrainingRecipe
from s2rtools.training.training_frames import DomainFrames, TrainingFrames
from s2rtools.training.training_loop import Budget, TrainingResult, train

__all__ = [
    "RECIPES",
    "Budget",
    "DomainFrames",
    "TrainingFrames",
    "TrainingRecipe",
    "TrainingResult",
    "train",
]

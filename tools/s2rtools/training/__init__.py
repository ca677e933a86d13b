"""Training of pose networks on a store's frames.

Registry: `RECIPES` maps a recipe's name to a `TrainingRecipe`. To add a recipe, write its
augmentation in one module and add one line to `RECIPES`.
"""

from s2rtools.training.recipes import RECIPES, TrainingRecipe
from s2rtools.training.training_frames import CopiedFrames, StreamedFrames, TrainingFrames
from s2rtools.training.training_loop import Budget, TrainingResult, train

__all__ = [
    "RECIPES",
    "Budget",
    "CopiedFrames",
    "StreamedFrames",
    "TrainingFrames",
    "TrainingRecipe",
    "TrainingResult",
    "train",
]

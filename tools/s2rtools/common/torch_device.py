"""The device on which networks are trained and translators run."""

from __future__ import annotations

import torch


def device() -> torch.device:
    """The first GPU that torch can use, else the processor; `CUDA_VISIBLE_DEVICES=` hides GPUs."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")

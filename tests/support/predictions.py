"""Files of made-up predictions for the instances of any store with poses."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import s2rstore
from s2rstore.records import SIDES

COLUMNS = ("iid", "side", "x", "y", "heading")


@dataclass(frozen=True)
class Made:
    """Predictions (N, 3) of both sides near the truth: x, y in metres, heading in radians."""

    sim: np.ndarray
    real: np.ndarray

    def of(self, side: str) -> np.ndarray:
        return self.sim if side == "sim" else self.real


def make(store: Path, seed: int = 0) -> Made:
    """Predictions that are off by 0.1 m (sim) and 0.4 m (real), and 5 degrees."""
    rng = np.random.default_rng(seed)
    with s2rstore.open(store) as opened:
        truth = opened.instances
        poses = np.column_stack([truth.x, truth.y, truth.heading])
    sim, real = (
        poses + rng.normal(0, 1, poses.shape) * [metres, metres, 0.09] for metres in (0.1, 0.4)
    )
    return Made(sim, real)


def write_rows(path: Path, names: Sequence[str], rows: Sequence[Sequence[object]]) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(rows)
    return path


def rows_of(made: Made) -> list[tuple[object, ...]]:
    """Rows of `COLUMNS`, those of sim first."""
    return [
        (iid, side, *map(repr, pose.tolist()))
        for side in SIDES
        for iid, pose in enumerate(made.of(side))
    ]


def write_csv(path: Path, made: Made) -> Path:
    """Both sides by iid."""
    return write_rows(path, COLUMNS, rows_of(made))

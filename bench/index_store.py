"""Build a store of any number of instances with eight runs, index only, to measure scaling.

Sixteen trajectories lead through twelve rooms; the errors differ between runs and between rooms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import angles
from s2rstore.geometry.rooms import room_codes
from s2rstore.index.transaction import IndexTransaction, edit
from s2rstore.metrics import pose_metrics
from s2rstore.records import Room
from s2rtools.models.input_contract import InputContract

WIDTH, HEIGHT = 40.0, 24.0
RUNS = ("vanilla", "perlin", "dataaug", "finetune", "bright", "dark", "warm", "translated")
ROOMS = tuple(
    Room(f"room {column + 4 * row + 1}", column + 4 * row, 10.0 * column, 8.0 * row,
         10.0 * column + 10, 8.0 * row + 8)
    for row in range(3) for column in range(4)
)  # fmt: skip
_TRAJECTORIES = 16


def build(path: Path, n: int, seed: int = 11, runs: Sequence[str] = RUNS) -> Path:
    """Write the store and return its path; arrays of frames and heatmaps are missing."""
    rng = np.random.default_rng(seed)
    per = -(-n // _TRAJECTORIES)
    turn = np.cumsum(rng.normal(0, 0.08, n))
    x = _folded(np.cumsum(0.06 * np.cos(turn)) + 20, WIDTH)
    y = _folded(np.cumsum(0.06 * np.sin(turn)) + 12, HEIGHT)
    heading = np.mod(turn + np.pi, 2 * np.pi) - np.pi
    codes = room_codes(x, y, ROOMS, [room.room for room in ROOMS])
    number = np.arange(n) // per
    with edit(path) as draft:
        _dataset(draft, n, per)
        draft.insert(
            "instance",
            {
                "iid": np.arange(n, dtype=np.int32),
                "trajectory": _words([f"walk-{i:02d}" for i in range(_TRAJECTORIES)], number),
                "seq": np.arange(n) - number * per,
                "x": x,
                "y": y,
                "heading": heading,
                "room": _words([room.room for room in ROOMS], codes),
                "curvature": rng.normal(0, 12, n),
            },
        )
        draft.insert("frame", frame_rows(n))
        for index, run in enumerate(runs):
            _run(draft, run, index, (x, y, heading), codes, rng)
    return path


def frame_rows(n: int) -> dict[str, Any]:
    rng = np.random.default_rng(3)
    names = [f"walk/{iid:08d}.png" for iid in range(n)] * 2
    digests = rng.bytes(32 * 2 * n).hex()
    return {
        "iid": np.tile(np.arange(n, dtype=np.int32), 2),
        "domain": ["sim"] * n + ["real"] * n,
        "rgb_path": names,
        "depth_path": names,
        "sha256": [digests[64 * row : 64 * row + 64] for row in range(2 * n)],
        "valid_depth_fraction": rng.random(2 * n),
    }


def _words(names: list[str], codes: NDArray[np.integer[Any]]) -> NDArray[np.object_]:
    return np.array(names, dtype=object)[codes]


def _folded(values: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Positions reflected at both ends of 0 .. size."""
    return size - np.abs(np.mod(values, 2 * size) - size)


def _dataset(draft: IndexTransaction, n: int, per: int) -> None:
    draft.insert_row(
        "dataset",
        {
            "name": f"bench {n}", "hash": f"{n:064x}", "bounds_x0": 0.0, "bounds_y0": 0.0,
            "bounds_x1": WIDTH, "bounds_y1": HEIGHT, "y_down": True, "floor_plan": None,
            "accuracy_scale": 46.0, "frame_height": 64, "frame_width": 64,
        },
    )  # fmt: skip
    for index in range(_TRAJECTORIES):
        count = max(0, min(per, n - index * per))
        if count:
            row = {"trajectory": f"walk-{index:02d}", "instances": count}
            draft.insert_row("trajectory", row)
    for room in ROOMS:
        draft.insert_row("room", {name: getattr(room, name) for name in room.__slots__})
    for domain in ("sim", "real"):
        cameras = {
            f"{image}_{figure}": value
            for image in ("rgb", "depth")
            for figure, value in (("fx", 32.0), ("fy", 32.0), ("cx", 32.0), ("cy", 32.0),
                                  ("pitch", 0.0))
        }  # fmt: skip
        draft.insert_row(
            "domain",
            {
                "domain": domain, "kind": domain, **cameras, "camera_height": 1.0,
                "forward_offset": 0.0, "depth_scale": 0.001, "depth_raw_min": 1,
                "depth_raw_max": 60000, "source": {"rgb": "declared", "depth": "declared"},
            },
        )  # fmt: skip
    draft.insert_row(
        "model",
        {"model": "posest", "architecture": "posest", "sha256": "0" * 64, "input_height": 64,
         "input_width": 64,
         "convention": {"heading": "cos_sin", "frame": "map"}, "trained_by": None,
         "input": asdict(InputContract(size=(64, 64)))},
    )  # fmt: skip


def run_row(run: str, index: int) -> dict[str, Any]:
    """The row of a computed run in table `run`."""
    return {
        "run": run, "model": "posest", "sim_domain": "sim", "real_domain": "real",
        "sim_adjustments": [], "real_adjustments": [], "key": f"{index:016x}",
        "precision": "float32", "created_at": f"2026-01-01T00:00:{index:02d}+00:00",
    }  # fmt: skip


def _run(
    draft: IndexTransaction, run: str, index: int, pose: tuple[NDArray[np.float64], ...],
    codes: NDArray[np.integer[Any]], rng: np.random.Generator,
) -> None:  # fmt: skip
    x, y, heading = pose
    n = x.size
    draft.insert_row("run", run_row(run, index))
    for side in ("sim", "real"):
        hard = 1 + 2 * (codes == (index + 3) % len(ROOMS)) if side == "real" else 1
        spread = (0.25 if side == "sim" else 0.6 + 0.1 * index) * hard
        px, py = x + rng.normal(0, spread, n), y + rng.normal(0, spread, n)
        turned = heading + rng.normal(0, 0.1, n)
        error = pose_metrics.position_error(px, py, x, y)
        off = angles.distance(turned, heading)
        place = np.full(n, run, dtype=object), np.full(n, side, dtype=object)
        draft.insert(
            "prediction",
            {
                "run": place[0], "iid": np.arange(n, dtype=np.int32), "side": place[1], "x": px,
                "y": py, "heading": np.mod(turned + np.pi, 2 * np.pi) - np.pi, "error": error,
                "heading_error": off, "loss": pose_metrics.pose_loss(error, off),
                "accuracy": pose_metrics.accuracy(error, 46.0), "rank": pose_metrics.rank(error),
                "split": np.full(n, "unseen", dtype=object),
            },
        )  # fmt: skip
        u = x / 4 + codes % 3 + rng.normal(0, 0.3, n) + (side == "real")
        v = y / 4 + codes // 3 + rng.normal(0, 0.3, n)
        draft.insert(
            "projection",
            {"run": place[0], "iid": np.arange(n, dtype=np.int32), "side": place[1], "u": u,
             "v": v},
        )  # fmt: skip

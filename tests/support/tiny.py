"""A small synthetic store: two trajectories, two rooms, and runs with known errors."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from s2rstore.arrays import array_writer
from s2rstore.files import layout
from s2rstore.files.ledger import Ledger
from s2rstore.geometry import angles
from s2rstore.geometry.rooms import room_codes
from s2rstore.index import schema
from s2rstore.index.schema import GAP_SHARES
from s2rstore.index.transaction import IndexTransaction, edit
from s2rstore.metrics import pose_metrics
from s2rstore.records import Room
from s2rtools.datasets.writing.build import unlisted_checksums
from s2rtools.models.input_contract import InputContract

ROOMS = (Room("left hall", 0, 0.0, 0.0, 5.0, 8.0), Room("right", 1, 5.0, 0.0, 10.0, 8.0))
RUNS = ("vanilla", "dataaug")
SIZE = 16


def poses(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A walk through both rooms: x, y in metres, heading in radians."""
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return (
        5 + 4.5 * np.cos(t),
        4 + 3.5 * np.sin(t),
        np.mod(t + np.pi / 2 + np.pi, 2 * np.pi) - np.pi,
    )


def build(
    path: Path,
    n: int = 40,
    runs: tuple[str, ...] = RUNS,
    seed: int = 0,
    trained: tuple[str, ...] = (),
) -> Path:
    """Write a store of `n` instances at `path` and return the path.

    The runs `trained` were trained on four of five sim images, the others on none.
    """
    path.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    first = n * 5 // 8
    x, y, heading = poses(n)
    with edit(path) as draft:
        _dataset(draft, n, first)
        codes = room_codes(x, y, ROOMS, [room.room for room in ROOMS])
        draft.insert(
            "instance",
            {
                "iid": np.arange(n, dtype=np.int32),
                "trajectory": ["a"] * first + ["b"] * (n - first),
                "seq": np.concatenate([np.arange(first), np.arange(n - first)]),
                "x": x,
                "y": y,
                "heading": heading,
                "room": [ROOMS[code].room if code >= 0 else None for code in codes],
                "curvature": rng.normal(0, 12, n),
            },
        )
        for domain in ("sim", "real"):
            names = [f"{iid:04d}.png" for iid in range(n)]
            iids = np.arange(n, dtype=np.int32)
            draft.insert("frame", {"iid": iids, "domain": [domain] * n, "rgb_path": names})
        for number, run in enumerate(runs):
            _run(draft, run, number, (x, y, heading), rng, run in trained)
        _labels(draft, n, runs)
        _faults(draft, n)
    _frames(path, n, first, rng)
    _heatmaps(path, n, runs, rng)
    return path


def _dataset(draft: IndexTransaction, n: int, first: int) -> None:
    draft.insert_row(
        "dataset",
        {
            "name": "tiny", "hash": "0" * 64, "bounds_x0": 0.0, "bounds_y0": 0.0,
            "bounds_x1": 10.0, "bounds_y1": 8.0, "y_down": True, "floor_plan": None,
            "accuracy_scale": 12.0, "frame_height": SIZE, "frame_width": SIZE,
        },
    )  # fmt: skip
    for name, count in (("a", first), ("b", n - first)):
        draft.insert_row("trajectory", {"trajectory": name, "instances": count})
    for room in ROOMS:
        draft.insert_row("room", {s: getattr(room, s) for s in room.__slots__})
    for domain in ("sim", "real"):
        cameras = {
            f"{image}_{figure}": value
            for image in ("rgb", "depth")
            for figure, value in (
                ("fx", 8.0),
                ("fy", 8.0),
                ("cx", 8.0),
                ("cy", 8.0),
                ("pitch", 0.0),
            )
        }
        draft.insert_row(
            "domain",
            {
                "domain": domain, "kind": domain, **cameras, "camera_height": 0.6,
                "forward_offset": 0.0, "depth_scale": 10 / 255, "depth_raw_min": 6,
                "depth_raw_max": 249, "source": {"cameras": "declared"},
            },
        )  # fmt: skip


def _run(
    draft: IndexTransaction,
    run: str,
    number: int,
    truth: tuple[np.ndarray, ...],
    rng: np.random.Generator,
    trained: bool,
) -> None:
    x, y, heading = truth
    n = x.size
    draft.insert_row(
        "model",
        {"model": run, "architecture": "resposenet", "sha256": f"{number:064d}",
         "input_height": SIZE, "input_width": SIZE,
         "convention": {"heading": "cos_sin", "frame": "map"}, "trained_by": None,
         "input": asdict(InputContract(size=(SIZE, SIZE)))},
    )  # fmt: skip
    draft.insert_row(
        "run",
        {"run": run, "model": run, "sim_domain": "sim", "real_domain": "real",
         "sim_adjustments": [], "real_adjustments": [], "key": f"key{number}",
         "precision": "float32", "created_at": f"2026-01-0{number + 1}T00:00:00Z"},
    )  # fmt: skip
    errors: dict[str, np.ndarray] = {}
    for side, spread in (("sim", 0.4), ("real", 1.5 / (number + 1))):
        px, py = x + rng.normal(0, spread, n), y + rng.normal(0, spread, n)
        angle = np.mod(heading + rng.normal(0, 0.2, n) + np.pi, 2 * np.pi) - np.pi
        error = np.sqrt((px - x) * (px - x) + (py - y) * (py - y))
        errors[side] = error
        off = angles.distance(angle, heading)
        learned = "train" if trained else "test"
        split = np.where(np.arange(n) % 5 < 4, learned, "test") if side == "sim" else "unseen"
        draft.insert(
            "prediction",
            {
                "run": [run] * n, "iid": np.arange(n, dtype=np.int32), "side": [side] * n,
                "x": px, "y": py, "heading": angle, "error": error, "heading_error": off,
                "loss": pose_metrics.pose_loss(error, off),
                "accuracy": pose_metrics.accuracy(error, 12.0),
                "rank": pose_metrics.rank(error), "split": list(np.broadcast_to(split, n)),
                "outlier": error / np.median(error),
                **(_shares(error - errors["sim"]) if side == "real" else {}),
            },
        )  # fmt: skip
        draft.insert(
            "projection",
            {"run": [run] * n, "iid": np.arange(n, dtype=np.int32), "side": [side] * n,
             "u": px * 0.5, "v": py * 0.5},
        )  # fmt: skip


def _labels(draft: IndexTransaction, n: int, runs: tuple[str, ...]) -> None:
    """Two chairs, each on its own images, and a fire door on every second one; no label images."""
    draft.insert("label", {"label": [1, 2, 3], "name": ["chair", "chair", "fire door"]})
    shown = [(iid, label) for label, each in ((1, 3), (2, 4), (3, 2)) for iid in range(0, n, each)]
    iids, labels = np.array(shown, dtype=np.int32).T
    draft.insert("frame_label", {"iid": iids, "domain": ["real"] * iids.size, "label": labels,
                                 "share": np.full(iids.size, 0.1)})  # fmt: skip
    for number, run in enumerate(runs):
        gains = 0.5 * np.sin(iids * (number + 1.0)) + 0.25 * (labels == 3)
        draft.insert("label_gain", {"run": [run] * iids.size, "iid": iids, "label": labels,
                                    "gain": gains})  # fmt: skip


def _faults(draft: IndexTransaction, n: int) -> None:
    """Two kinds of faults, each in both domains."""
    for name, domain, each in (("blurred", "real", 5), ("blurred", "sim", 7), ("frozen", "real", 6),
                               ("frozen", "sim", 6)):  # fmt: skip
        iids = np.arange(1, n, each, dtype=np.int32)
        draft.insert("frame_fault", {"iid": iids, "domain": [domain] * iids.size,
                                     "fault": [name] * iids.size})  # fmt: skip
    draft.set_provenance(schema.HEALTH, {"sim": str(n), "real": str(n)})


def _shares(gap: np.ndarray) -> dict[str, np.ndarray]:
    """Shares that sum to the gap; lighting causes the most of it."""
    parts = np.array([0.6, 0.2, 0.1, 0.15, -0.05], dtype=np.float32)
    return {name: gap.astype(np.float32) * part
            for name, part in zip(GAP_SHARES, parts, strict=True)}  # fmt: skip


def _frames(path: Path, n: int, first: int, rng) -> None:
    ledger = Ledger(path)
    for domain in ("sim", "real"):
        for name, count in (("a", first), ("b", n - first)):
            for image, shape, top in (("rgb", (SIZE, SIZE, 3), 256), ("depth", (SIZE, SIZE), 256)):
                relative = Path(layout.FRAMES, domain, name, image)
                array_writer.create(
                    path / relative, array_writer.plan_layout(count, shape, "uint8", 16)
                )
                rows = rng.integers(0, top, (count, *shape)).astype(np.uint8)
                _write(path, ledger, relative, rows, 16)


def _heatmaps(path: Path, n: int, runs: tuple[str, ...], rng) -> None:
    ledger = Ledger(path)
    with edit(path) as draft:
        draft.record_checksums(unlisted_checksums(path))
        for number, run in enumerate(runs):
            specs = [
                ("activation", "sim", None, (4, 4, 4), "output x row x column"),
                ("activation", "real", None, (4, 4, 4), "output x row x column"),
                ("feature_distance", None, None, (4, 4), "row x column"),
                *(
                    ("occlusion", side, mode, (2, 6, 6), "unit x row x column")
                    for side in ("sim", "real")
                    for mode in ("rgb", "depth", "rgbd")
                ),
                ("gap_shares", None, None, (len(GAP_SHARES),), "factor"),
            ]
            for kind, side, mode, shape, axes in specs:
                name = ".".join(part for part in (kind, mode, side) if part)
                relative = f"{run}/key{number}/{name}"
                plan = array_writer.plan_layout(n, shape, "float32", 16)
                array = array_writer.create(path / layout.RUNS / relative, plan)
                drawn = kind != "gap_shares"
                rows = rng.normal(0, 1, (n, *shape)) if drawn else np.zeros((n, *shape))
                rows = rows.astype(np.float32)
                _write(path, ledger, Path(layout.RUNS, relative), rows, 16)
                draft.insert_row(
                    "zarr_array",
                    {"run": run, "kind": kind, "side": side, "mode": mode, "path": relative,
                     "dtype": "float32", "shape": [n, *shape],
                     "axes": ["iid", *axes.split(" x ")], "scale": 1.0, "zero": 0.0, "unit": "m",
                     "metadata_sha256": array.metadata_sha256},
                )  # fmt: skip


def _write(path: Path, ledger: Ledger, relative: Path, rows: np.ndarray, shard: int) -> None:
    for number, start in enumerate(range(0, len(rows), shard)):
        file = array_writer.write_shard(path / relative, number, rows[start : start + shard])
        relative_file = file.path
        ledger.add(
            f"{relative.as_posix()}:{number}", [(relative_file, len(rows[start : start + shard]))]
        )

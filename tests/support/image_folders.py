"""Folders of sim and real images without poses, and stores of them."""

from pathlib import Path

import cv2
import numpy as np

from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import Scan, ScanOptions
from s2rtools.datasets.writing.build import build

SIM_SIZE, REAL_SIZE = (48, 96), (64, 128)
"""(height, width) of the images; both have the aspect ratio 2."""
CONDITIONS = {"night": 3, "day": 4}
"""Real images of each condition."""


def picture(number: int, size: tuple[int, int]) -> np.ndarray:
    """An RGB image (*size, 3) that depends on the number alone."""
    coarse = np.random.default_rng(number).integers(0, 256, (6, 12, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, size[::-1], interpolation=cv2.INTER_LINEAR))


def write(path: Path, rgb: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), rgb[..., ::-1])
    return path


def folders(root: Path) -> dict[str, Path]:
    """Sim: 5 and 2 images in two folders. Real: `images/`, `masks/` and `index.csv`."""
    for number in range(5):
        write(root / "sim" / "loop" / f"{number}.png", picture(number, SIM_SIZE))
    for number in range(5, 7):
        write(root / "sim" / "city" / f"{number}.png", picture(number, SIM_SIZE))
    lines, number = ["source,file,condition"], 100
    for condition, count in CONDITIONS.items():
        for step in reversed(range(count)):  # the order of the index differs from that of names
            name = f"{condition}_{step}.png"
            write(root / "real" / "images" / name, picture(number, REAL_SIZE))
            lines.append(f"camera,{name},{condition}")
            number += 1
    write(root / "real" / "masks" / "night_0.png", picture(1, REAL_SIZE))
    (root / "real" / "index.csv").write_text("\n".join(lines) + "\n")
    return {"sim": root / "sim", "real": root / "real"}


def ingest(
    sources: dict[str, Path], store: Path, long_edge: int = 64, strict: bool = False, **options
) -> Scan:
    frame = long_edge, long_edge
    scan = IMPORTERS["images"](Path(), ScanOptions(frame=frame, folders=sources, **options))
    build(scan, store, "s2r ingest images", strict, lambda steps: None)
    return scan


def image_store(root: Path) -> Path:
    """A store of 14 images: trajectories real_day, real_night, sim_city and sim_loop."""
    ingest(folders(root / "data"), root / "images.s2r")
    return root / "images.s2r"

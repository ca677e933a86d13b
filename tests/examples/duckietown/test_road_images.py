"""Folders of road images: what is read, and one-line errors for damaged ones."""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from examples.duckietown.road_images import read_road_images
from tests.support.refusals import refused

FIRST = "day-00_0000"


def _without_mask(folder: Path) -> None:
    (folder / "masks" / f"{FIRST}.png").unlink()


def _unknown_label(folder: Path) -> None:
    cv2.imwrite(str(folder / "masks" / f"{FIRST}.png"), np.full((320, 640), 9, np.uint8))


def _broken_image(folder: Path) -> None:
    (folder / "images" / f"{FIRST}.jpg").write_bytes(b"not an image")


def _index(text: str) -> Callable[[Path], None]:
    return lambda folder: (folder / "index.csv").write_text(text) and None


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (_without_mask, "missing"),
        (_unknown_label, "label 9"),
        (_broken_image, "cannot be decoded"),
        (_index("file\na.jpg\n"), "condition"),
        (_index("file,condition\n../a.jpg,day\n"), "inside images/"),
        (_index("file,condition,labelled\na.jpg,day,no\na.jpg,day,no\n"), "twice"),
    ],
)
def test_damaged_folders_are_refused_in_one_line(rendered_folder, tmp_path, damage, message):
    folder = tmp_path / "roads"
    shutil.copytree(rendered_folder, folder)
    damage(folder)
    with refused(str(folder), message):
        read_road_images(folder)

"""Folders of road images with line masks: `images/`, `masks/` and `index.csv`.

`index.csv` has the columns `file` and `condition`, and may have `labelled` (yes, or no), `sequence`
(the recording; by default the part of the file name before the last underscore) and `offset` and
`heading` (the true pose in the lane, metres and radians). The mask of `images/NAME.jpg` is
`masks/NAME.png` of the same size: 0 road or other, 1 white, 2 yellow, 3 red, 255 ignore.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from numpy.typing import NDArray

from examples.duckietown.line_detector import (
    COLOURS,
    DETECTOR_SIZE,
    Crop,
    detector_images,
    road_part,
)
from examples.duckietown.road_renderer import IGNORE, Mask
from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_bytes, read_text
from s2rtools.translation.image_set import MAX_IMAGE_BYTES, ImageSet, Rgb, read_image

Floats = NDArray[np.float64]

INDEX = "index.csv"
_LABELS = np.array([*range(len(COLOURS) + 1), IGNORE])
_YES, _NO = ("yes", "true", "1", "mask", "labelled"), ("no", "false", "0", "")
_MAX_INDEX_BYTES = 16 << 20


@dataclass(frozen=True, slots=True, eq=False)
class RoadImages:
    """Images (N, 80, 160, 3) and masks (N, 80, 160) at the detector's resolution.

    `conditions` and `sequences` (N,) are names; the mask of an unlabelled image is `IGNORE`
    throughout. `poses` (N, 2) are lane offset and heading, NaN where unknown.
    """

    name: str
    images: Rgb
    masks: Mask
    labelled: NDArray[np.bool_]
    conditions: NDArray[np.str_]
    sequences: NDArray[np.str_]
    files: tuple[str, ...]
    poses: Floats

    def __len__(self) -> int:
        return len(self.images)

    def rows(self, rows: NDArray[np.generic]) -> RoadImages:
        """The images of some rows (indices or a mask)."""
        index = np.arange(len(self))[rows]
        return RoadImages(
            self.name, self.images[index], self.masks[index], self.labelled[index],
            self.conditions[index], self.sequences[index],
            tuple(self.files[row] for row in index), self.poses[index],
        )  # fmt: skip

    def image_set(self) -> ImageSet:
        """The images for fitting translators; a group is a sequence."""
        groups = np.unique(self.sequences, return_inverse=True)[1].astype(np.int32)
        return ImageSet(self.name, self.images, groups, self.files)


@dataclass(frozen=True, slots=True)
class _Row:
    file: str
    condition: str
    sequence: str
    labelled: bool
    pose: tuple[float, float]


def read_road_images(folder: Path, crop: Crop = "auto") -> RoadImages:
    """The images and masks of a folder. Raises RequestError for a damaged one."""
    rows = _read_index(folder)
    images = np.empty((len(rows), *DETECTOR_SIZE, 3), dtype=np.uint8)
    masks = np.full((len(rows), *DETECTOR_SIZE), IGNORE, dtype=np.uint8)
    for number, row in enumerate(rows):
        path = folder / "images" / row.file
        image = read_image(path)
        images[number] = detector_images(image[None], crop)[0]
        if row.labelled:
            mask = _read_mask(_mask_path(folder, row.file), image.shape[:2])
            masks[number] = reduce_mask(road_part(mask[None], crop)[0])
    return RoadImages(
        folder.name, images, masks, np.array([row.labelled for row in rows]),
        np.array([row.condition for row in rows]), np.array([row.sequence for row in rows]),
        tuple(row.file for row in rows), np.array([row.pose for row in rows]),
    )  # fmt: skip


def reduce_mask(mask: Mask) -> Mask:
    """A mask at the detector's resolution: the label of most of the pixel, else ignore."""
    best = np.full(DETECTOR_SIZE, IGNORE, dtype=np.uint8)
    for label in _LABELS[:-1]:
        share = cv2.resize(
            (mask == label).astype(np.float32), DETECTOR_SIZE[::-1], interpolation=cv2.INTER_AREA
        )
        best[share > 0.5] = label
    return best


def _read_index(folder: Path) -> list[_Row]:
    path = folder / INDEX
    if not folder.is_dir():
        raise RequestError(f"{folder}: no such folder")
    if not path.is_file():
        raise RequestError(f"{path}: missing; it needs the columns file and condition")
    try:
        reader = csv.DictReader(io.StringIO(read_text(path, _MAX_INDEX_BYTES)), strict=True)
        missing = {"file", "condition"} - set(reader.fieldnames or ())
        if missing:
            raise RequestError(f"{path}: no column {sorted(missing)[0]!r}")
        has_labels = "labelled" in (reader.fieldnames or ())
        rows = [
            _row(folder, f"{path}: line {reader.line_num}", fields, has_labels) for fields in reader
        ]
    except csv.Error as error:
        raise RequestError(f"{path}: not valid CSV ({error})") from error
    if not rows:
        raise RequestError(f"{path}: no images")
    files = [row.file for row in rows]
    if len(set(files)) < len(files):
        twice = next(file for file in files if files.count(file) > 1)
        raise RequestError(f"{path}: {twice} twice")
    return rows


def _row(folder: Path, where: str, fields: dict[str, str | None], has_labels: bool) -> _Row:
    values = {str(name): str(value or "").strip() for name, value in fields.items()}
    file = values["file"]
    name = PurePosixPath(file)
    if not file or name.is_absolute() or ".." in name.parts:
        raise RequestError(f"{where}: file {file!r} must be a path inside images/")
    if not values["condition"]:
        raise RequestError(f"{where}: no condition of {file}")
    if has_labels:
        text = values["labelled"].lower()
        if text not in _YES + _NO:
            raise RequestError(f"{where}: labelled {text!r}: must be yes or no")
        labelled = text in _YES
    else:
        labelled = _mask_path(folder, file).exists()
    stem = name.with_suffix("").as_posix()
    sequence = values.get("sequence") or stem.rpartition("_")[0] or values["condition"]
    pose = (_number(where, values, "offset"), _number(where, values, "heading"))
    return _Row(file, values["condition"], sequence, labelled, pose)


def _number(where: str, values: dict[str, str], name: str) -> float:
    text = values.get(name, "")
    if not text:
        return math.nan
    try:
        number = float(text)
    except ValueError:
        number = math.inf
    if not math.isfinite(number):
        raise RequestError(f"{where}: {name} {text!r}: not a number")
    return number


def _mask_path(folder: Path, file: str) -> Path:
    return folder / "masks" / PurePosixPath(file).with_suffix(".png")


def _read_mask(path: Path, size: tuple[int, int]) -> Mask:
    if not path.is_file():
        raise RequestError(f"{path}: missing, but {INDEX} says that the image is labelled")
    content = np.frombuffer(read_bytes(path, MAX_IMAGE_BYTES), dtype=np.uint8)
    mask = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if content.size else None
    if mask is None or mask.ndim != 2 or mask.dtype != np.uint8:
        raise RequestError(f"{path}: not an 8-bit image of one channel")
    if mask.shape != size:
        raise RequestError(
            f"{path}: {mask.shape[1]} x {mask.shape[0]} pixels, its image has {size[1]} x {size[0]}"
        )
    unknown = np.setdiff1d(np.unique(mask), _LABELS)
    if unknown.size:
        raise RequestError(f"{path}: label {unknown[0]}: must be 0, 1, 2, 3 or 255")
    return np.asarray(mask)

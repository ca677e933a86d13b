"""Write rendered road images as a folder that `road_images` reads."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from examples.duckietown.conditions import Condition, LightField
from examples.duckietown.fisheye_camera import FisheyeCamera
from examples.duckietown.road_images import INDEX
from examples.duckietown.road_renderer import LanePose, Mask, build_town, drive
from s2rstore.errors import RequestError
from s2rtools.common.result_files import write_all
from s2rtools.translation.image_set import Rgb

FRAMES_PER_SEQUENCE = 20
_JPEG_QUALITY = 92
_COLUMNS = ("file", "condition", "labelled", "sequence", "offset", "heading")


@dataclass(frozen=True, slots=True, eq=False)
class LitFrame:
    """A rendered frame under a condition, its recording and its place in it."""

    rgb: Rgb
    mask: Mask
    pose: LanePose
    condition: str
    sequence: str
    number: int


def lit_frames(
    conditions: Sequence[Condition],
    frames: int,
    seed: int,
    lines: bool = True,
    camera: FisheyeCamera = FisheyeCamera(),  # noqa: B008
) -> Iterator[LitFrame]:
    """`frames` frames per condition in recordings of 20; each recording has a town of its own.

    Recording i of every condition drives the same way through the same town.
    """
    for first in range(0, frames, FRAMES_PER_SEQUENCE):
        part = first // FRAMES_PER_SEQUENCE
        town = build_town(seed * 1000 + part, lines=lines)
        count = min(FRAMES_PER_SEQUENCE, frames - first)
        fields = [
            LightField(each, (camera.rows, camera.width), seed * 1000 + part * 50 + index)
            for index, each in enumerate(conditions)
        ]
        for number, frame in enumerate(drive(town, count, seed * 1000 + part, camera)):
            for condition, light in zip(conditions, fields, strict=True):
                sequence = f"{condition.name}-{part:02d}"
                rgb = light.apply(frame.rgb)
                yield LitFrame(rgb, frame.mask, frame.pose, condition.name, sequence, number)


def write_rendered(
    out: Path,
    conditions: Sequence[Condition],
    frames: int,
    seed: int,
    lines: bool = True,
    advance: Callable[[int], None] = lambda steps: None,
) -> int:
    """Write a folder of rendered images, masks and index; returns the number of images.

    Raises RequestError where the folder exists and is not empty.
    """
    if frames < 1:
        raise RequestError(f"--frames {frames}: must be at least 1")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise RequestError(f"{out}: exists and is not empty; name another folder")
    try:
        for folder in ("images", "masks"):
            (out / folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RequestError(f"{out}: cannot be created ({error.strerror})") from error
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(_COLUMNS)
    count = 0
    for frame in lit_frames(conditions, frames, seed, lines):
        name = f"{frame.sequence}_{frame.number:04d}"
        bgr = np.ascontiguousarray(frame.rgb[..., ::-1])
        jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
        png = cv2.imencode(".png", frame.mask)[1]
        write_all(
            {
                out / "images" / f"{name}.jpg": jpeg.tobytes(),
                out / "masks" / f"{name}.png": png.tobytes(),
            }
        )
        pose = (f"{frame.pose.offset:.4f}", f"{frame.pose.heading:.4f}")
        writer.writerow((f"{name}.jpg", frame.condition, "yes", frame.sequence, *pose))
        count += 1
        advance(1)
    write_all({out / INDEX: table.getvalue().encode()})
    return count

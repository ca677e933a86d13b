"""A folder of rendered frames: a recording of layout csv, and what is in it already.

    frames.csv       a row for each frame: images, pose of the camera, trajectory
    frames.toml      the camera
    rgb/KEY.png      the PNG that the renderer wrote
    depth/KEY.png    16-bit depth in the units of the domain, 0 = none

The key of a frame is a hash of the renderer's name and version, the camera, all parameter values
and the pose; a frame that exists is not rendered again.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, safe_files
from s2rstore.records import Domain, Intrinsics
from s2rtools.renderer.frames import RenderedFrame
from s2rtools.renderer.protocol import CameraPose, Ready

TABLE, DESCRIPTION = "frames.csv", "frames.toml"
_COLUMNS = ("rgb", "depth", "x", "y", "z", "qx", "qy", "qz", "qw", "trajectory")
_MOST_TABLE = 256 << 20
_KEY_DIGITS = 24
_MOST_HEADER = 1 << 16


def prepare_folder(path: Path) -> None:
    """Make a folder for frames. Raises RequestError where it holds other files."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        names = {entry.name for entry in path.iterdir() if entry.is_file()}
    except OSError as error:
        reason = error.strerror or error
        raise RequestError(f"{path}: cannot be used as a folder for frames ({reason})") from error
    if names and DESCRIPTION not in names:
        raise RequestError(f"{path}: holds other files; choose a new folder")


class FrameFolder:
    """The frames of the cameras of a domain; several threads may save different frames."""

    def __init__(self, path: Path, domain: Domain, frame: tuple[int, int], has_depth: bool) -> None:
        """Make the folder for frames of a size (height, width) of a domain's cameras.

        Raises RequestError where it holds frames of other cameras.
        """
        self.path, self._domain, self._frame, self.has_depth = path, domain, frame, has_depth
        text = self._description().encode()
        try:
            present = safe_files.read(path, DESCRIPTION, 1 << 16)
        except FileNotFoundError:
            atomic_writes.write(path, DESCRIPTION, text)
            return
        if present != text:
            raise RequestError(f"{path}: holds frames of other cameras; choose a new folder")

    def key(self, ready: Ready, pose: CameraPose, parameters: dict[str, float]) -> str:
        """The key of a frame, which names its files; `pose` is that of the RGB camera."""
        lenses = [asdict(lens) for lens in (self._domain.rgb, self._domain.depth)]
        facts = ready.name, ready.version, self._frame, lenses, pose, sorted(parameters.items())
        return hashlib.sha256(msgspec.json.encode(facts)).hexdigest()[:_KEY_DIGITS]

    def has(self, key: str, *images: str) -> bool:
        """Whether the images of a frame exist, by default all."""
        wanted = images or (("rgb", "depth") if self.has_depth else ("rgb",))
        return all(safe_files.kind(self.path, f"{each}/{key}.png") == "file" for each in wanted)

    def save(self, key: str, frame: RenderedFrame, images: Collection[str]) -> None:
        """Write the named images of a frame, `rgb` and `depth`."""
        if "depth" in images and self.has_depth and frame.depth is not None:
            _, png = cv2.imencode(
                ".png", self.raw_depth(frame.depth), [cv2.IMWRITE_PNG_COMPRESSION, 1]
            )
            atomic_writes.write(self.path, f"depth/{key}.png", png.tobytes(), durable=False)
        if "rgb" in images:
            atomic_writes.write(self.path, f"rgb/{key}.png", frame.png, durable=False)

    def read(self, key: str) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
        """RGB (height, width, 3) and depth (height, width) in the units of the domain.

        Without depth it is 0. Raises RequestError for a frame that is no image any longer.
        """
        rgb = self._image(f"rgb/{key}.png", cv2.IMREAD_COLOR)[..., ::-1]
        if not self.has_depth:
            return rgb, np.zeros(self._frame, np.uint16)
        return rgb, self._image(f"depth/{key}.png", cv2.IMREAD_UNCHANGED)

    def _image(self, name: str, mode: int) -> NDArray[Any]:
        limit = 8 * self._frame[0] * self._frame[1] + _MOST_HEADER
        content = np.frombuffer(safe_files.read(self.path, name, limit), np.uint8)
        image: Any = cv2.imdecode(content, mode)
        if image is None or image.shape[:2] != self._frame:
            raise RequestError(f"{self.path / name}: damaged; delete it")
        return np.asarray(image)

    def raw_depth(self, metres: NDArray[np.float32]) -> NDArray[np.uint16]:
        """Depth in the units of the domain; 0 where there is none or it is out of range."""
        raw = np.rint(metres.astype(np.float64) / self._domain.depth_scale)
        valid = (raw >= self._domain.depth_raw_min) & (raw <= self._domain.depth_raw_max)
        return np.where(valid, raw, 0).astype(np.uint16)

    def add_rows(self, frames: Sequence[tuple[str, str, CameraPose]], anew: bool) -> None:
        """Add rows of frames that exist: key, trajectory and pose of the camera.

        They follow the rows of the table, without those that it has. With `anew` they replace the
        rows of their trajectories, which then are in the order of `frames`.
        """
        rows = self._rows()
        if anew:
            names = {trajectory for _, trajectory, _ in frames}
            rows = [row for row in rows if row[-1] not in names]
        present = Counter((row[0], row[-1]) for row in rows)
        for key, trajectory, pose in frames:
            rgb, depth = f"rgb/{key}.png", f"depth/{key}.png"
            if present[rgb, trajectory] > 0:
                present[rgb, trajectory] -= 1
            elif self.has(key):
                w, x, y, z = map(repr, pose.quaternion)
                at = map(repr, pose.position)
                rows.append([rgb, depth if self.has_depth else "", *at, x, y, z, w, trajectory])
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([_COLUMNS, *rows])
        atomic_writes.write(self.path, TABLE, text.getvalue().encode())

    def _rows(self) -> list[list[str]]:
        try:
            content = safe_files.read(self.path, TABLE, _MOST_TABLE)
        except FileNotFoundError:
            return []
        rows = list(csv.reader(io.StringIO(content.decode(errors="replace"))))
        if rows[:1] != [list(_COLUMNS)] or any(len(row) != len(_COLUMNS) for row in rows):
            raise RequestError(f"{self.path / TABLE}: not as `s2r render` writes it; delete it")
        return rows[1:]

    def _description(self) -> str:
        domain = self._domain
        depth = f"depth_scale = {domain.depth_scale!r}\ndepth_raw_max = {domain.depth_raw_max}\n\n"
        text = (depth if self.has_depth else "") + self._table("camera", domain.rgb)
        if self.has_depth and domain.depth != domain.rgb:
            text += "\n" + self._table("depth_camera", domain.depth)
        return text

    def _table(self, name: str, lens: Intrinsics) -> str:
        values = {"width": self._frame[1], "height": self._frame[0], "fx": lens.fx, "fy": lens.fy,
                  "cx": lens.cx, "cy": lens.cy}  # fmt: skip
        lines = "".join(f"{key} = {value!r}\n" for key, value in values.items())
        return f"[{name}]\n{lines}"

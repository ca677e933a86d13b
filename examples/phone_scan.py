"""Data as a phone gives them: the scan of a room, and a walk through it that was photographed.

`python -m examples.phone_scan DIR` writes `scan.glb`, a textured mesh; `walk`, the raw data export
of Polycam; and `places.csv`, two corners of the room on the mesh and on the map. The walk is
rendered of another mesh than the scan: a cupboard was moved in between. Its photographs are darker,
have more contrast, noise, and a camera that looks 2 degrees down. Needs VTK (`s2rtui[mesh]`).
"""

from __future__ import annotations

import argparse
import json
import math
import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.renderer.mesh import MeshScene
from s2rtools.renderer.protocol import Hello

ROOM = 6.0, 4.5, 2.6
"""Length, width and height of the room, metres."""
TURN, SHIFT = math.radians(25.0), (1.5, -0.8)
"""The walk's axes in those of the scan: a phone begins each recording with its own."""
CUPBOARD = (4.6, 0.3, 0.0, 1.0, 0.5, 1.9)
MOVED = (1.9, 3.5, 0.0, 1.0, 0.5, 1.9)
"""The cupboard in the scan and in the walk: x, y, z and size of the box, metres."""
FURNITURE = ((2.4, 1.9, 0.0, 1.2, 0.7, 0.75), (0.2, 2.6, 0.0, 0.9, 1.6, 0.8))
"""A table and a sofa."""
EYE = 1.4
"""Height of the phone, metres."""
WIDTH, HEIGHT, FOCAL = 192, 144, 130.0
_TO_PHONE = np.diag([1.0, -1.0, -1.0])
"""From optical axes (x right, y down, z forward) to those of ARKit (y up, z backward)."""
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From axes whose z points up to those whose y does."""

Corners = NDArray[np.float64]


def texture(seed: int, colour: tuple[int, int, int]) -> NDArray[np.uint8]:
    """A pattern (128, 128, 3) of tiles and blots around a colour, in which places look unlike."""
    rng = np.random.default_rng(seed)
    tiles = rng.integers(-45, 46, (6, 6, 3)).astype(np.float32)
    coarse = cv2.resize(tiles, (128, 128), interpolation=cv2.INTER_NEAREST)
    blots = rng.normal(0, 25, (24, 24, 1)).astype(np.float32)
    fine = cv2.resize(blots, (128, 128), interpolation=cv2.INTER_CUBIC)[..., None]
    return np.clip(np.array(colour) + coarse + fine, 0, 255).astype(np.uint8)


def room(cupboard: tuple[float, ...]) -> list[tuple[Corners, NDArray[np.uint8]]]:
    """Rectangles (4, 3) of the room with their textures; z points up, the origin is a corner."""
    length, width, height = ROOM
    box = 0.0, 0.0, 0.0, length, width, height
    faces = [(face, texture(k, (190, 180, 165))) for k, face in enumerate(_box(*box))]
    for number, solid in enumerate((cupboard, *FURNITURE), 1):
        colour = ((70, 95, 150), (120, 75, 50), (60, 120, 80))[number - 1]
        faces += [(face, texture(10 * number + k, colour)) for k, face in enumerate(_box(*solid))]
    return faces


def _box(x: float, y: float, z: float, *size: float) -> list[Corners]:
    """The six sides (4, 3) of a box."""
    sides = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for end in (0.0, 1.0):
            corners = np.zeros((4, 3))
            corners[:, axis] = end
            corners[:, u], corners[:, v] = (0, 1, 1, 0), (0, 0, 1, 1)
            sides.append(np.array([x, y, z]) + corners * size)
    return sides


def write_glb(path: Path, faces: Sequence[tuple[NDArray[np.floating], NDArray[np.uint8]]]) -> None:
    """Write textured rectangles as binary glTF 2.0.

    Each has its corners (4, 3) in the axes of glTF, whose y points up, and a texture (h, w, 3) RGB,
    whose lower left corner is at the first one.
    """
    uv = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
    blocks = [uv.tobytes(), np.array([0, 1, 2, 0, 2, 3], np.uint16).tobytes()]
    accessors: list[dict[str, object]] = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC2"},
        {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
    ]
    primitives = []
    for number, (corners, image) in enumerate(faces):
        points = np.asarray(corners, np.float32)
        limits = {"min": points.min(0).tolist(), "max": points.max(0).tolist()}
        accessors.append({"bufferView": len(blocks), "componentType": 5126, "count": 4,
                          "type": "VEC3", **limits})  # fmt: skip
        attributes = {"POSITION": len(accessors) - 1, "TEXCOORD_0": 0}
        primitives.append({"attributes": attributes, "indices": 1, "material": number})
        png = cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1].tobytes()
        blocks += [points.tobytes(), png]
    views, content = [], b""
    for block in blocks:
        views.append({"buffer": 0, "byteOffset": len(content), "byteLength": len(block)})
        content += block + b"\0" * (-len(block) % 4)
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "materials": [
            {"pbrMetallicRoughness": {"baseColorTexture": {"index": number}}}
            for number in range(len(faces))
        ],
        "textures": [{"source": number, "sampler": 0} for number in range(len(faces))],
        "images": [
            {"bufferView": 3 + 2 * number, "mimeType": "image/png"} for number in range(len(faces))
        ],
        "samplers": [{"magFilter": 9729, "minFilter": 9729}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(content)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(content), 0x004E4942) + content
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def walk_poses(count: int) -> NDArray[np.float64]:
    """Places and headings (count, 3) of a walk around the table, in the axes of the scan."""
    turn = np.linspace(0, 4 * np.pi, count, endpoint=False)
    x, y = 3.0 + 1.6 * np.cos(turn), 2.2 + 0.95 * np.sin(turn)
    return np.stack([x, y, turn + np.pi / 2 + 0.9 * np.sin(3 * turn)], axis=1)


def write_walk(folder: Path, count: int, seed: int = 1) -> None:
    """Photograph a walk of `count` images in the export of Polycam, and write the scan's places."""
    scan = folder / "walk.glb"
    write_glb(scan, [(face @ _Y_UP.T, image) for face, image in room(MOVED)])
    scene, rng = MeshScene(scan, np.eye(4)), np.random.default_rng(seed)
    lens = Hello(width=WIDTH, height=HEIGHT, fx=FOCAL, fy=FOCAL, cx=WIDTH / 2, cy=HEIGHT / 2,
                 y_down=False, folder="")  # fmt: skip
    frames = folder / "walk" / "keyframes"
    for kind in ("corrected_images", "corrected_cameras", "depth"):
        (frames / kind).mkdir(parents=True, exist_ok=True)
    for number, (x, y, heading) in enumerate(walk_poses(count)):
        rotation, position = _camera(heading, math.radians(-2.0)), np.array([x, y, EYE])
        rgb, depth = scene.render(rotation, position, lens)
        light = 0.75 * (127.5 + 1.2 * (rgb - 127.5)) + rng.normal(0, 4, rgb.shape)
        name = str(1_000_000 + 200_000 * number)  # its time, microseconds
        photograph = np.clip(light, 0, 255).astype(np.uint8)[..., ::-1]
        cv2.imwrite(str(frames / "corrected_images" / f"{name}.png"), photograph)
        cv2.imwrite(str(frames / "depth" / f"{name}.png"), np.rint(1000 * depth).astype(np.uint16))
        stated = _stated_pose(rotation, position)
        camera = {"width": WIDTH, "height": HEIGHT, "fx": FOCAL, "fy": FOCAL,
                  "cx": WIDTH / 2, "cy": HEIGHT / 2, **stated}  # fmt: skip
        (frames / "corrected_cameras" / f"{name}.json").write_text(json.dumps(camera))
    scan.unlink()


def _camera(heading: float, pitch: float) -> NDArray[np.float64]:
    """(3, 3): the directions to the right, down and forward of a camera, as columns."""
    forward = np.array(
        [math.cos(heading) * math.cos(pitch), math.sin(heading) * math.cos(pitch), math.sin(pitch)]
    )
    right = np.array([math.sin(heading), -math.cos(heading), 0.0])
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def in_walk(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places (n, 2) of the scan in the axes of the walk."""
    cos, sin = math.cos(TURN), math.sin(TURN)
    return (places - SHIFT) @ np.array([[cos, -sin], [sin, cos]])


def _stated_pose(rotation: NDArray[np.float64], position: NDArray[np.float64]) -> dict[str, float]:
    """A pose as Polycam states it, in the axes of the walk."""
    cos, sin = math.cos(TURN), math.sin(TURN)
    turned = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]])
    pose = np.zeros((3, 4))
    pose[:, :3] = _Y_UP @ turned @ rotation @ _TO_PHONE
    pose[:, 3] = _Y_UP @ np.array([*in_walk(position[None, :2])[0], position[2]])
    return {f"t_{i}{j}": float(pose[i, j]) for i in range(3) for j in range(4)}


def write_places(path: Path) -> None:
    """Two corners of the room, as one reads them off the mesh and off the map."""
    corners = np.array([(0.0, 0.0), ROOM[:2]])
    rows = [",".join(f"{value:.3f}" for value in (*a, *b))
            for a, b in zip(corners, in_walk(corners), strict=True)]  # fmt: skip
    path.write_text("\n".join(["mesh_x,mesh_y,x_m,y_m", *rows]) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description="Write the scan of a room and a walk through it.")
    parser.add_argument("folder", type=Path, help="folder to write to")
    parser.add_argument("--images", type=int, default=120, help="images of the walk (default 120)")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    faces = [(face @ _Y_UP.T, image) for face, image in room(CUPBOARD)]
    write_glb(options.folder / "scan.glb", faces)
    write_walk(options.folder, options.images)
    write_places(options.folder / "places.csv")
    print(f"{options.folder}: scan.glb, places.csv and walk with {options.images} images")


if __name__ == "__main__":
    main()

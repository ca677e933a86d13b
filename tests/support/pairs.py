"""Write small paired data sets in both layouts that `s2r ingest` reads."""

import csv
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 64, 48
_DOMAIN = """
[domains.{name}]
kind = "{kind}"
width = 64
height = 48
rgb = {{ {rgb} }}
depth = {{ hfov = 80.0 }}
camera_height = {height}
depth_scale = 0.0392156862745098
depth_raw_min = 6
depth_raw_max = 249
"""
SIM_EDIT = _DOMAIN.format(name="sim_edit", kind="sim", rgb="hfov = 80.0", height=0.6)
HEADER = """
name = "small"
y_down = true
accuracy_scale = 10.0
[bounds]
x0 = 0.0
y0 = 0.0
x1 = 8.0
y1 = 6.0
[[rooms]]
room = "west"
rectangles = [[0.0, 0.0, 4.0, 6.0]]
[[rooms]]
room = "east"
rectangles = [[4.0, 0.0, 8.0, 6.0]]
"""
HEADER += _DOMAIN.format(name="sim", kind="sim", rgb="hfov = 80.0", height=0.6)
HEADER += _DOMAIN.format(name="real", kind="real", rgb="hfov = 70.0, pitch = 2.0", height=0.5)


def render_pair(x: float, y: float, heading: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """An RGB image and a depth image that depend on the pose, with a little noise."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.linspace(-1, 1, WIDTH), np.linspace(-1, 1, HEIGHT))
    angle = heading + 0.7 * u
    walls = np.stack([np.sin(3 * angle + x), np.cos(2 * angle + y), np.sin(angle + x - y)], axis=-1)
    rgb = 128 + 90 * walls * (1 - 0.3 * np.abs(v)[..., None]) + rng.normal(0, 4, (*u.shape, 3))
    metres = 1.5 + 2 * (1 + np.sin(angle * 2 + x)) - 0.8 * v + rng.normal(0, 0.02, u.shape)
    depth = np.clip(metres / 10 * 255, 0, 255)
    depth[:3] = 0
    return np.clip(rgb, 0, 255).astype(np.uint8), depth.astype(np.uint8)


def circular_poses(n: int) -> list[tuple[float, float, float]]:
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return [
        (round(float(4 + 3 * np.cos(a)), 3), round(float(3 + 2 * np.sin(a)), 3), float(a))
        for a in t
    ]


def _save(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    encoded = image if image.ndim == 2 else image[..., ::-1]
    assert cv2.imwrite(str(path), encoded, [cv2.IMWRITE_JPEG_QUALITY, 95])


def sim2realviz(
    root: Path, n: int = 24, trajectories: tuple[str, ...] = ("traj1",), edit: bool = False
) -> Path:
    """Write the Sim2RealViz layout and return the calibration file (cameras of 64 x 48 images)."""
    for number, trajectory in enumerate(trajectories):
        rows = []
        for index, (x, y, heading) in enumerate(circular_poses(n)):
            degrees = round(float(np.degrees(-np.pi / 2 - heading)))
            degrees = (degrees + 180) % 360 - 180
            sim = f"x{x:.3f}_y0.047_z{y:.3f}_r{degrees}"
            real = f"x{-y:.3f}_y{x + number:.3f}_z0.000_r{index}"
            domains = [("sim", sim, 0.0), ("real", real, 0.15)]
            if edit:
                domains.append(("sim_edit", sim, 0.05))
            for domain, name, shift in domains:
                rgb, depth = render_pair(x + shift, y, heading + shift, 100 * number + index)
                _save(root / trajectory / domain / f"{name}_rgb.jpeg", rgb)
                _save(root / trajectory / domain / f"{name}_depth.jpeg", depth)
            rows.append((f"{real}_rgb.jpeg", f"{sim}_rgb.jpeg"))
        with (root / trajectory / "sim" / "match.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["REAL_RGB", "SIM_RGB"])
            writer.writerows(rows)
    header = root / "calibration.toml"
    header.write_text(HEADER + (SIM_EDIT if edit else ""))
    return header


def manifest(root: Path, n: int = 12, bits: int = 8) -> Path:
    """Write a CSV manifest with PNG images and its TOML header; return the manifest."""
    root.mkdir(parents=True, exist_ok=True)
    rows = []
    for index, (x, y, heading) in enumerate(circular_poses(n)):
        for domain, shift in (("sim", 0.0), ("real", 0.1)):
            rgb, depth = render_pair(x + shift, y, heading, index)
            names = f"{domain}/{index}_rgb.png", f"{domain}/{index}_depth.png"
            (root / domain).mkdir(exist_ok=True)
            cv2.imwrite(str(root / names[0]), rgb[..., ::-1])
            cv2.imwrite(str(root / names[1]), depth.astype(np.uint16) * 39 if bits == 16 else depth)
            pose = [x, y, round(float(np.degrees(heading)), 4)]
            rows.append(["a" if index < n // 2 else "b", index, domain, *names, *pose, 0.1 * index])
    with (root / "data.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["trajectory", "seq", "domain", "rgb", "depth", "x", "y", "heading", "timestamp"]
        )
        writer.writerows(rows)
    text = HEADER
    if bits == 16:
        text = text.replace("depth_scale = 0.0392156862745098", "depth_scale = 0.001")
        text = text.replace("depth_raw_max = 249", "depth_raw_max = 65000")
    (root / "data.toml").write_text(text)
    return root / "data.csv"

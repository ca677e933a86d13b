"""The layout of the Sim2RealViz data: traj1/{real,sim,sim_edit} with poses in the file names.

`sim/match.csv` (REAL_RGB, SIM_RGB) pairs the images in recording order. The sim pose is the
ground truth; the real one is the robot's odometry, in a frame of its own.
"""

from __future__ import annotations

import csv
import math
import re
from importlib import resources
from pathlib import Path
from typing import Any

from s2rstore import angles
from s2rstore.errors import RequestError
from s2rstore.layout import checked_name
from s2rtools.ingest import header
from s2rtools.ingest.scan import Images, Problem, Scan, ScanOptions, Sighting

_NAME = re.compile(
    r"x(?P<x>[^_]+)_y(?P<y>[^_]+)_z(?P<z>[^_]+)_r(?P<r>[^_]+)_(?:rgb|depth)\.(?:jpe?g|png)\Z"
)
_PLACES = ("", "data_source/traj_cap", "static/assets/data_source/traj_cap", "traj_cap")
_PLANS = ("map.jpg", "static/assets/images/map.jpg", "../../static/assets/images/map.jpg")
_DOMAINS = ("sim", "sim_edit", "real")


def scan(path: Path, options: ScanOptions) -> Scan:
    """Find trajectories, pairs and calibration under `path`.

    `path` holds `traj1/`, `traj2/` ... or is the root of the public repository. Raises
    RequestError where nothing of that layout lies there.
    """
    root = _root(path)
    calibration, where = _calibration(options.header)
    result = Scan(
        name=str(calibration.get("name", "sim2realviz")),
        root=root,
        frame=options.frame,
        y_down=bool(calibration.get("y_down", True)),
        bounds=header.bounds(calibration, where),
        accuracy_scale=float(calibration.get("accuracy_scale", 26.0)),
        domains={},
        rooms=header.rooms(calibration, where),
        floor_plan=_floor_plan(path, root),
        trajectories={},
    )
    for folder in _trajectories(root, options.trajectories):
        _scan_trajectory(result, folder, calibration)
    names = {name for rows in result.trajectories.values() for row in rows for name in row.images}
    for name in _DOMAINS:
        if name in names:
            result.domains[name] = header.domain(calibration, name, options.frame, where)
    return result


def _root(path: Path) -> Path:
    for place in _PLACES:
        folder = path / place
        if any(_is_trajectory(child) for child in folder.glob("*")):
            return folder
    if not path.is_dir():
        raise RequestError(f"{path}: no such folder")
    raise RequestError(
        f"{path}: no trajectory in it (a folder with sim/match.csv, sim/ and real/ images)"
    )


def _is_trajectory(folder: Path) -> bool:
    return (folder / "sim").is_dir() and (folder / "real").is_dir()


def _trajectories(root: Path, wanted: tuple[str, ...]) -> list[Path]:
    found = {folder.name: folder for folder in sorted(root.glob("*")) if _is_trajectory(folder)}
    for name in wanted:
        if name not in found:
            raise RequestError(f"--trajectory {name}: not in {root} (has: {', '.join(found)})")
    for name in found:
        checked_name(name, "trajectory")
    return [found[name] for name in wanted or found]


def _calibration(given: Path | None) -> tuple[dict[str, Any], Path]:
    if given is not None:
        return header.read(given), given
    packaged = resources.files("s2rtools.ingest") / "sim2realviz.toml"
    with resources.as_file(packaged) as path:
        return header.read(path), Path(path.name)


def _floor_plan(path: Path, root: Path) -> Path | None:
    for place in (path, root):
        for name in _PLANS:
            if (place / name).is_file():
                return place / name
    return None


def _scan_trajectory(result: Scan, folder: Path, calibration: dict[str, Any]) -> None:
    rows = _matches(result, folder)
    edited = folder / "sim_edit"
    seen: set[tuple[str, str]] = set()
    sightings: list[Sighting] = []
    for real, sim in rows:
        if (real, sim) in seen:
            result.problems.append(Problem("duplicate row", f"{folder.name}/sim/match.csv", real))
            continue
        seen.add((real, sim))
        images = {"sim": folder / "sim" / sim, "real": folder / "real" / real}
        if edited.is_dir():
            images["sim_edit"] = edited / sim
        sighting = _sighting(result, images, calibration)
        if sighting is not None:
            sightings.append(sighting)
    _report_unmatched(result, folder, seen)
    if not sightings:
        result.problems.append(Problem("empty trajectory", folder.name, "no usable pair"))
        return
    result.trajectories[folder.name] = sightings


def _matches(result: Scan, folder: Path) -> list[tuple[str, str]]:
    path = folder / "sim" / "match.csv"
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except FileNotFoundError:
        result.problems.append(Problem("no match.csv", result.relative(path)))
        return []
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RequestError(f"{path}: cannot be read ({error})") from error
    if rows and not {"REAL_RGB", "SIM_RGB"} <= set(rows[0]):
        raise RequestError(f"{path}: the first line must name REAL_RGB and SIM_RGB")
    made = []
    for number, row in enumerate(rows, start=2):
        real, sim = ((row[name] or "").strip() for name in ("REAL_RGB", "SIM_RGB"))
        if not _NAME.match(Path(real).name) or not _NAME.match(Path(sim).name):
            where = f"{result.relative(path)}:{number}"
            result.problems.append(Problem("bad name", where, f"{real},{sim}"))
            continue
        made.append((Path(real).name, Path(sim).name))
    return made


def _sighting(result: Scan, files: dict[str, Path], calibration: dict[str, Any]) -> Sighting | None:
    images: dict[str, Images] = {}
    for domain, rgb in files.items():
        depth = rgb.with_name(rgb.name.replace("_rgb.", "_depth."))
        missing = [path for path in (rgb, depth) if not path.is_file()]
        for path in missing:
            result.problems.append(Problem("missing image", result.relative(path)))
        if missing:
            return None
        images[domain] = Images(rgb, depth, header.size(calibration, domain))
    x, _, z, r = _numbers(files["sim"].name)
    odometry = _numbers(files["real"].name)
    if not all(math.isfinite(value) for value in (x, z, r)):
        result.problems.append(Problem("bad pose", result.relative(files["sim"])))
        return None
    return Sighting(
        x=x,
        y=z,
        heading=float(angles.from_habitat(math.radians(r))),
        images=images,
        odometry=(odometry[0], odometry[1], math.radians(odometry[3])),
    )


def _numbers(name: str) -> tuple[float, float, float, float]:
    found = _NAME.match(name)
    values = []
    for key in "xyzr":
        try:
            values.append(float(found[key]) if found else math.nan)
        except ValueError:
            values.append(math.nan)
    return values[0], values[1], values[2], values[3]


def _report_unmatched(result: Scan, folder: Path, pairs: set[tuple[str, str]]) -> None:
    named = {"real": {real for real, _ in pairs}, "sim": {sim for _, sim in pairs}}
    named["sim_edit"] = named["sim"]
    for domain, names in named.items():
        for path in sorted((folder / domain).glob("*_rgb.*")):
            if path.name not in names:
                result.problems.append(Problem("unmatched image", result.relative(path)))

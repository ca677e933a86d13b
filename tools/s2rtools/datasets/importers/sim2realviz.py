"""The layout of the Sim2RealViz data: traj1/{real,sim,sim_edit} with poses in the file names.

`sim/match.csv` (REAL_RGB, SIM_RGB) pairs the images in recording order. The sim pose is the
ground truth; the real one is the robot's odometry, in a frame of its own. Every instance is seen
in every domain, so that `sim_edit` counts where all chosen trajectories have it.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.files.layout import checked_name
from s2rstore.geometry import angles
from s2rtools.datasets import dataset_config
from s2rtools.datasets.csv_rows import read_rows
from s2rtools.datasets.image_decoding import Images, declared_size, size_text
from s2rtools.datasets.path_containment import Containment
from s2rtools.datasets.scan import InputIssue, InstanceRecord, Scan, ScanOptions

_NAME = re.compile(
    r"x(?P<x>[^_]+)_y(?P<y>[^_]+)_z(?P<z>[^_]+)_r(?P<r>[^_]+)_(?P<what>rgb|depth)"
    r"\.(?:jpe?g|png)\Z",
    re.IGNORECASE,
)
_PLACES = ("", "data_source/traj_cap", "static/assets/data_source/traj_cap", "traj_cap")
_PLAN = "static/assets/images/map.jpg"
_PLANS = ((0, "map.jpg"), (0, _PLAN), (2, _PLAN))
"""How many folders above the data, and where in that one."""
_EDITED = "sim_edit"
_DOMAINS = ("sim", _EDITED, "real")
_PEEKED = 3

Sizes = dict[str, tuple[tuple[int, int], tuple[int, int]]]


def scan(path: Path, options: ScanOptions) -> Scan:
    """Find trajectories, pairs and calibration under `path`.

    `path` holds `traj1/`, `traj2/` ... or is the root of the public repository. Raises
    RequestError where nothing of that layout lies there.
    """
    root = _root(path)
    calibration, where = _calibration(options.header)
    inside = Containment(path, options.allow_outside)
    result = Scan(
        name=str(calibration.get("name", "sim2realviz")),
        root=root,
        frame=options.frame,
        y_down=dataset_config.flag(calibration, "y_down", True, where),
        bounds=dataset_config.bounds(calibration, where),
        accuracy_scale=dataset_config.scale(calibration, 26.0, where),
        domains={},
        rooms=dataset_config.rooms(calibration, where),
        floor_plan=_floor_plan(path, root, inside),
        trajectories={},
    )
    folders = _trajectories(root, options.trajectories)
    names = [name for name in _DOMAINS if name != _EDITED or _edited_everywhere(result, folders)]
    result.domains = {n: dataset_config.domain(calibration, n, options.frame, where) for n in names}
    sizes = {name: dataset_config.sizes(calibration, name, where) for name in names}
    for folder in folders:
        _scan_trajectory(result, folder, sizes, inside)
    result.outside = inside.outside
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
        return dataset_config.read(given), given
    packaged = resources.files("s2rtools.datasets.importers") / "sim2realviz.toml"
    with resources.as_file(packaged) as path:
        return dataset_config.read(path), Path(path.name)


def _floor_plan(path: Path, root: Path, inside: Containment) -> Path | None:
    for place in (path, root):
        for up, name in _PLANS:
            folder = place.resolve().joinpath(*[os.pardir] * up)
            if (folder / name).is_file():
                return inside.under(folder).check(folder / name, str(folder / name))
    return None


def _edited_everywhere(result: Scan, folders: list[Path]) -> bool:
    """Whether `sim_edit` can be a domain; where only some trajectories have it, that is told."""
    recorded = [folder for folder in folders if _pictures(folder / "sim")]
    with_images = [folder for folder in recorded if _pictures(folder / _EDITED)]
    for folder in recorded:
        edited = folder / _EDITED
        if folder in with_images:
            continue
        if edited.is_dir():
            result.problems.append(InputIssue("empty folder", result.relative(edited)))
        if with_images:
            keep = " ".join(f"--trajectory {other.name}" for other in with_images)
            detail = f"{_EDITED} is left out; {keep} keeps it"
            result.problems.append(InputIssue("domain not everywhere", folder.name, detail))
    return bool(recorded) and len(with_images) == len(recorded)


def _scan_trajectory(result: Scan, folder: Path, sizes: Sizes, inside: Containment) -> None:
    inside.check(folder / "sim" / "match.csv", str(folder / "sim" / "match.csv"))
    rows = _matches(result, folder)
    images = [_images(folder, real, sim, sizes) for real, sim in rows]
    for image in (image for row in images for image in row.values()):
        for file in (image.rgb, image.depth):
            inside.check(file, str(file))
    images = _as_stored(result, folder, images)
    _report_unmatched(result, folder, rows, list(sizes))
    sightings = [_sighting(result, files) for files in images]
    found = [sighting for sighting in sightings if sighting is not None]
    if not found:
        result.problems.append(InputIssue("empty trajectory", folder.name, "no usable pair"))
        return
    result.trajectories[folder.name] = found


def _matches(result: Scan, folder: Path) -> list[tuple[str, str]]:
    """The (real, sim) RGB file names of match.csv, each real image once."""
    path = folder / "sim" / "match.csv"
    made: dict[str, str] = {}
    for number, row in _rows(result, path):
        where = f"{result.relative(path)}:{number}"
        real, sim = (Path(row.get(name, "")).name for name in ("REAL_RGB", "SIM_RGB"))
        if not real and not sim:
            continue
        if not all((match := _NAME.match(name)) and match["what"] == "rgb" for name in (real, sim)):
            result.problems.append(InputIssue("bad name", where, f"{real},{sim}"))
        elif real in made:
            detail = real if made[real] == sim else f"{real} with another sim image; kept the first"
            result.problems.append(InputIssue("duplicate row", where, detail))
        else:
            made[real] = sim
    return list(made.items())


def _rows(result: Scan, path: Path) -> list[tuple[int, dict[str, str]]]:
    if not path.exists():
        result.problems.append(InputIssue("no match.csv", result.relative(path)))
        return []
    rows = list(read_rows(path, ("REAL_RGB", "SIM_RGB")))
    if rows and not {"REAL_RGB", "SIM_RGB"} <= set(rows[0][1]):
        raise RequestError(f"{path}: the first line must name REAL_RGB and SIM_RGB")
    return rows


def _images(folder: Path, real: str, sim: str, sizes: Sizes) -> dict[str, Images]:
    names = {name: real if name == "real" else sim for name in sizes}
    return {
        name: Images(folder / name / file, folder / name / _depth_name(file), *sizes[name])
        for name, file in names.items()
    }


def _depth_name(rgb: str) -> str:
    return re.sub(r"_rgb(\.\w+)\Z", r"_depth\1", rgb, flags=re.IGNORECASE)


def _as_stored(
    result: Scan, folder: Path, rows: list[dict[str, Images]]
) -> list[dict[str, Images]]:
    """Expect another size than the calibration's where a domain's images agree on a scaled one.

    The intrinsics of the stored frame hold for every size of the same shape.
    """
    scaled: dict[str, tuple[int, int]] = {}
    for name in rows[0] if rows else ():
        images = [row[name] for row in rows[:_PEEKED]]
        files = [file for image in images for file in (image.rgb, image.depth) if file.is_file()]
        found = {declared_size(file) for file in files}
        size = found.pop() if len(found) == 1 else None
        declared = images[0].rgb_size, images[0].depth_size
        if size is None or declared == (size, size):
            continue
        if all(size[0] * wide == size[1] * high for high, wide in declared):
            scaled[name] = size
            detail = f"{size_text(size)}, the calibration is for {size_text(declared[0])}; scaled"
            where = result.relative(folder / name)
            result.problems.append(InputIssue("other size than calibrated", where, detail))
    return [
        {
            name: replace(image, rgb_size=scaled[name], depth_size=scaled[name])
            if name in scaled else image
            for name, image in row.items()
        }
        for row in rows
    ]  # fmt: skip


def _sighting(result: Scan, images: dict[str, Images]) -> InstanceRecord | None:
    files = [file for image in images.values() for file in (image.rgb, image.depth)]
    missing = [file for file in files if not file.is_file()]
    result.problems += [InputIssue("missing image", result.relative(file)) for file in missing]
    if missing:
        return None
    x, _, z, r = _numbers(images["sim"].rgb.name)
    odometry = _numbers(images["real"].rgb.name)
    if not all(math.isfinite(value) for value in (x, z, r)):
        result.problems.append(InputIssue("bad pose", result.relative(images["sim"].rgb)))
        return None
    return InstanceRecord(
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


def _report_unmatched(
    result: Scan, folder: Path, pairs: list[tuple[str, str]], domains: list[str]
) -> None:
    for domain in domains:
        used = {real if domain == "real" else sim for real, sim in pairs}
        used |= {_depth_name(name) for name in used}
        for path in _pictures(folder / domain):
            if path.name not in used:
                result.problems.append(InputIssue("unmatched image", result.relative(path)))


def _pictures(folder: Path) -> list[Path]:
    """Image files by name, whatever their name says."""
    endings = (".jpg", ".jpeg", ".png")
    return sorted(path for path in folder.glob("*") if path.suffix.lower() in endings)

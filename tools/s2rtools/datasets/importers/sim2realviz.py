"""Import the Sim2RealViz layout: traj1/{real,sim,sim_edit} with poses in the file names.

`sim/match.csv` (REAL_RGB, SIM_RGB) pairs the images in recording order. The sim pose is the
ground truth; the real pose is the robot's odometry, in the odometry's frame. A trajectory may lack
`sim_edit`.
"""

from __future__ import annotations

import math
import os
import re
from array import array
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rstore.lazy_sequence import LazySequence, RowFile
from s2rstore.records import Side
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.csv_rows import parse_float, read_rows
from s2rtools.datasets.dataset_config import DatasetConfig, Size
from s2rtools.datasets.files.image_decoding import declared_size, size_text
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recordings.image_frame_source import ImageFrameSource, source_of_files
from s2rtools.datasets.scan import InstanceRecord, Scan, ScanOptions

_NAME = re.compile(
    r"x(?P<x>[^_]+)_y(?P<y>[^_]+)_z(?P<z>[^_]+)_r(?P<r>[^_]+)_(?P<image>rgb|depth)"
    r"\.(?:jpe?g|png)\Z",
    re.IGNORECASE,
)
_DATA_FOLDERS = ("", "data_source/traj_cap", "static/assets/data_source/traj_cap", "traj_cap")
_REPOSITORY_FLOOR_PLAN = "static/assets/images/map.jpg"
_FLOOR_PLANS = ((0, "map.jpg"), (0, _REPOSITORY_FLOOR_PLAN), (2, _REPOSITORY_FLOOR_PLAN))
"""Number of folders above the data, and the path below that folder."""
_EDITED = "sim_edit"
_DOMAINS = ("sim", _EDITED, "real")
_SAMPLED_IMAGES = 3

Sizes = dict[str, tuple[Size, Size]]


def scan(path: Path, options: ScanOptions) -> Scan:
    """Find trajectories, pairs and calibration under `path`.

    `path` holds `traj1/`, `traj2/` ... or is the root of the public repository. Raises
    RequestError if it has no such layout.
    """
    root = _root(path)
    packaged = resources.files("s2rtools.datasets.importers") / "sim2realviz.toml"
    with resources.as_file(packaged) as default:
        config = DatasetConfig(
            options.header or default, name="sim2realviz", y_down=True, accuracy_scale=26.0
        )
    containment = PathContainment(path, options.allow_outside)
    result = config.empty_scan(root, options.frame, containment)
    if result.floor_plan is None:
        result.floor_plan = _floor_plan(path, root, containment)
    known = {folder.name: folder for folder in sorted(root.glob("*")) if _is_trajectory(folder)}
    folders = [known[name] for name in options.choose_trajectories(known, root)]
    edited = [folder for folder in folders if _has_sim_edit(result, folder)]
    names = [name for name in _DOMAINS if name != _EDITED or edited]
    result.domains = {name: config.domain(name, options.frame) for name in names}
    for folder in folders:
        of_folder = [name for name in names if name != _EDITED or folder in edited]
        sizes = {name: config.image_sizes(name) for name in of_folder}
        _scan_trajectory(result, folder, sizes, containment)
    return result


def _root(path: Path) -> Path:
    for name in _DATA_FOLDERS:
        folder = path / name
        if any(_is_trajectory(child) for child in folder.glob("*")):
            return folder
    if not path.is_dir():
        raise RequestError(f"{path}: no such folder")
    raise RequestError(
        f"{path}: no trajectory in it (a folder with sim/match.csv, sim/ and real/ images)"
    )


def _is_trajectory(folder: Path) -> bool:
    return (folder / "sim").is_dir() and (folder / "real").is_dir()


def _floor_plan(path: Path, root: Path, containment: PathContainment) -> Path | None:
    for start in (path, root):
        for levels_up, name in _FLOOR_PLANS:
            folder = start.resolve().joinpath(*[os.pardir] * levels_up)
            if (folder / name).is_file():
                return containment.for_folder(folder).check(folder / name, str(folder / name))
    return None


def _has_sim_edit(result: Scan, folder: Path) -> bool:
    """Whether a trajectory has images of `sim_edit`; reports a folder of it without any."""
    edited = folder / _EDITED
    if _image_files(edited):
        return True
    if edited.is_dir():
        result.issues.append(InputIssue("empty folder", result.relative(edited)))
    return False


def _scan_trajectory(
    result: Scan, folder: Path, sizes: Sizes, containment: PathContainment
) -> None:
    containment.check(folder / "sim" / "match.csv", str(folder / "sim" / "match.csv"))
    rows, used_names = _matched_names(result, folder)
    for number in range(len(rows)):
        for image in _images(folder, rows[number], sizes).values():
            for file in image.files:
                containment.check(file, str(file))
    first = [_images(folder, rows[number], sizes) for number in range(len(rows))[:_SAMPLED_IMAGES]]
    sizes = _actual_sizes(result, folder, first, sizes)
    for domain in sizes:
        used = used_names["real" if domain == "real" else "sim"]
        for name in _image_files(folder / domain):
            if name not in used:
                path = folder / domain / name
                result.issues.append(InputIssue("unmatched image", result.relative(path)))
    usable = array("i")
    for number in range(len(rows)):
        if _is_usable(result, _images(folder, rows[number], sizes)):
            usable.append(number)

    def record(row: int) -> InstanceRecord:
        return _instance_record(_images(folder, rows[usable[row]], sizes))

    result.add_trajectory(folder.name, LazySequence(len(usable), record))


def _matched_names(result: Scan, folder: Path) -> tuple[RowFile, dict[Side, set[str]]]:
    """(real, sim) RGB file names in match.csv, each real image once, and all names by kind.

    The latter include those of the depth images.
    """
    path = folder / "sim" / "match.csv"
    matched = RowFile()
    used: dict[Side, set[str]] = {"real": set(), "sim": set()}
    numbers: dict[str, int] = {}
    if not path.exists():
        result.issues.append(InputIssue("no match.csv", result.relative(path)))
        return matched, used
    for count, (number, row) in enumerate(read_rows(path, ("REAL_RGB", "SIM_RGB"))):
        if not count and not {"REAL_RGB", "SIM_RGB"} <= set(row):
            raise RequestError(f"{path}: the first line must name REAL_RGB and SIM_RGB")
        where = f"{result.relative(path)}:{number}"
        real, sim = (Path(row.get(name, "")).name for name in ("REAL_RGB", "SIM_RGB"))
        if not real and not sim:
            continue
        matches = [_NAME.match(name) for name in (real, sim)]
        if not all(match and match["image"] == "rgb" for match in matches):
            result.issues.append(InputIssue("bad name", where, f"{real},{sim}"))
        elif real in numbers:
            same = matched[numbers[real]][1] == sim
            more = "" if same else " with another sim image; the first is used"
            result.issues.append(InputIssue("duplicate row", where, f"{real}{more}"))
        else:
            numbers[real] = matched.append(real, sim)
            used["real"] |= {real, _depth_name(real)}
            used["sim"] |= {sim, _depth_name(sim)}
    return matched, used


def _images(folder: Path, matched: Sequence[str], sizes: Sizes) -> dict[str, ImageFrameSource]:
    """The images of an instance by domain; `matched` are its real and its sim RGB file name."""
    real, sim = matched
    sources = {}
    for domain, size in sizes.items():
        rgb = f"{folder.name}/{domain}/{real if domain == 'real' else sim}"
        sources[domain] = source_of_files(folder.parent, rgb, _depth_name(rgb), size)
    return sources


def _depth_name(rgb: str) -> str:
    return re.sub(r"_rgb(\.\w+)\Z", r"_depth\1", rgb, flags=re.IGNORECASE)


def _actual_sizes(
    result: Scan, folder: Path, sample: list[dict[str, ImageFrameSource]], sizes: Sizes
) -> Sizes:
    """Replace the calibrated image sizes by the actual ones if those are scaled versions of them.

    The intrinsics of the stored frame hold for every size of the same aspect ratio.
    """
    actual_sizes = dict(sizes)
    for name, declared in sizes.items():
        files = [file for row in sample for file in row[name].files if os.path.isfile(file)]
        actual = {declared_size(file) for file in files}
        size = actual.pop() if len(actual) == 1 else None
        if size is None or declared == (size, size):
            continue
        if all(size[0] * width == size[1] * height for height, width in declared):
            actual_sizes[name] = size, size
            detail = f"{size_text(size)}, the calibration is for {size_text(declared[0])}; scaled"
            where = result.relative(folder / name)
            result.issues.append(InputIssue("other size than calibrated", where, detail))
    return actual_sizes


def _is_usable(result: Scan, sources: dict[str, ImageFrameSource]) -> bool:
    """Whether all files of an instance exist and its sim pose is finite; reports it if not."""
    paths = (file for image in sources.values() for file in image.files)
    missing = [file for file in paths if not os.path.isfile(file)]
    result.issues += [InputIssue("missing image", result.relative(file)) for file in missing]
    if missing:
        return False
    sim = sources["sim"].frame.rgb.name
    x, _, z, r = _pose_in_name(sim)
    is_finite = all(math.isfinite(value) for value in (x, z, r))
    if not is_finite:
        result.issues.append(InputIssue("bad pose", sim))
    return is_finite


def _instance_record(sources: dict[str, ImageFrameSource]) -> InstanceRecord:
    x, _, z, r = _pose_in_name(sources["sim"].frame.rgb.name)
    odometry = _pose_in_name(sources["real"].frame.rgb.name)
    return InstanceRecord(
        x=x,
        y=z,
        heading=float(angles.from_habitat(math.radians(r))),
        sources=sources,
        odometry=(odometry[0], odometry[1], math.radians(odometry[3])),
    )


def _pose_in_name(file: str) -> list[float]:
    """x, y, z and rotation in the name of a file; NaN for values that do not parse."""
    match = _NAME.match(Path(file).name)
    return [parse_float(match[key] if match else None) for key in "xyzr"]


def _image_files(folder: Path) -> list[str]:
    """Names of image files in order, including those that do not parse."""
    endings = (".jpg", ".jpeg", ".png")
    names = os.listdir(folder) if folder.is_dir() else []
    return sorted(name for name in names if os.path.splitext(name)[1].lower() in endings)

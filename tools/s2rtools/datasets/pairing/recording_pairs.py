"""Pair the images of a sim and of a real recording by pose, by time or by name."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Literal

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rstore.records import SIDES, Side
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.floor.floor_poses import FloorPoses
from s2rtools.datasets.pairing import pair_matching
from s2rtools.datasets.pairing.pair_matching import Floats, PoseTolerance, ReportProgress, Rows
from s2rtools.datasets.recording import RecordedFrame, Recording
from s2rtools.datasets.recordings.recorded_poses import nearest_times

Match = Literal["pose", "time", "name"]
DEFAULT_TOLERANCES: dict[Match, str] = {"pose": "0.2m,10deg", "time": "0.05s", "name": ""}

_UNITS = {"m": ("m", 1.0), "cm": ("m", 0.01), "mm": ("m", 0.001), "s": ("s", 1.0),
          "ms": ("s", 0.001), "deg": ("rad", math.pi / 180), "rad": ("rad", 1.0)}  # fmt: skip
_QUANTITY = re.compile(r"\s*([0-9.eE+-]+)\s*([a-z]+)\s*\Z")
_MOST = {"m": 1000.0, "s": 1e6, "rad": math.pi}


def parse_tolerance(text: str | None, match: Match) -> PoseTolerance | float | None:
    """`0.2m,10deg` for poses, `0.05s` for times, None for names; the default where None.

    Raises RequestError for another quantity, unit or range.
    """
    text = DEFAULT_TOLERANCES[match] if text is None else text
    needed = {"pose": {"m", "rad"}, "time": {"s"}, "name": set[str]()}[match]
    values: dict[str, float] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        found = _QUANTITY.match(part)
        unit, factor = _UNITS.get(found[2] if found else "", ("", 0.0))
        try:
            value = float(found[1]) * factor if found else math.nan
        except ValueError:
            value = math.nan
        if unit not in needed or unit in values or not 0 < value <= _MOST.get(unit, 0.0):
            raise RequestError(f"--tolerance {text}: {_expected_tolerance(match)}")
        values[unit] = value
    if set(values) != needed:
        raise RequestError(f"--tolerance {text}: {_expected_tolerance(match)}")
    if match == "pose":
        return PoseTolerance(values["m"], values["rad"])
    return values.get("s")


def _expected_tolerance(match: Match) -> str:
    if match == "name":
        return "--match name takes none"
    more = "a distance and an angle" if match == "pose" else "a time"
    return f"--match {match} takes {more}, such as {DEFAULT_TOLERANCES[match]}"


class RecordedSide:
    """The images of one side that have a pose on the floor, of all trajectories in order.

    `poses` (N, 3) are x, y in metres and heading in radians, `times` (N,) seconds, `codes` (N,) the
    numbers of the trajectories in `names`, `rows` (N,) the rows in these.
    """

    def __init__(self, side: Side, recording: Recording, floor: FloorPoses) -> None:
        self.side, self.recording, self.floor = side, recording, floor
        self.names = list(recording.trajectories)
        kept = [np.flatnonzero(floor.usable(name)) for name in self.names]
        counts = [len(rows) for rows in kept]
        self.codes = np.repeat(np.arange(len(kept)), counts)
        self.rows = np.concatenate([np.empty(0, dtype=np.intp), *kept])
        poses = [floor.poses[name][rows] for name, rows in zip(self.names, kept, strict=True)]
        self.poses = np.concatenate([np.empty((0, 3)), *poses])
        times = [
            recording.trajectories[name].timestamps[rows]
            for name, rows in zip(self.names, kept, strict=True)
        ]
        self.times = np.concatenate([np.empty(0), *times])

    def __len__(self) -> int:
        return len(self.rows)

    def frame(self, number: int) -> RecordedFrame:
        name = self.names[self.codes[number]]
        return self.recording.trajectories[name].frames[int(self.rows[number])]

    def image(self, number: int) -> str:
        """The name of an image."""
        return self.frame(number).rgb.name

    def camera_pose(self, number: int) -> Floats:
        """The pose of the camera in the recording's world, (4, 4)."""
        name = self.names[self.codes[number]]
        return self.recording.trajectories[name].poses[int(self.rows[number])]


@dataclass(frozen=True, slots=True, eq=False)
class Pairing:
    """Pairs of images: numbers in the sim and in the real side, (K,) each, by the real ones.

    `metres` and `degrees` are the offsets between the poses, `seconds` those between the times,
    NaN where unknown. `issues` report what could not be compared.
    """

    sim: Rows
    real: Rows
    metres: Floats
    degrees: Floats
    seconds: Floats
    issues: list[InputIssue] = field(default_factory=list)

    def unmatched(self, side: Side, count: int) -> Rows:
        """The numbers of the `count` images of a side that have no partner."""
        is_free = np.ones(count, dtype=np.bool_)
        is_free[self.sim if side == "sim" else self.real] = False
        return np.flatnonzero(is_free)


def pair_images(
    sim: RecordedSide,
    real: RecordedSide,
    match: Match,
    tolerance: PoseTolerance | float | None,
    progress: ReportProgress = lambda images: None,
) -> Pairing:
    """Pair the images of two sides one to one.

    Poses are compared over all trajectories if each recording has one world. Other poses, times and
    names are compared between trajectories of the same name, or where each side has one trajectory,
    between these. For the assignment and its
    cost see `pair_matching`; names are equal without folder and suffix.
    """
    issues: list[InputIssue] = []
    if isinstance(tolerance, PoseTolerance) and _have_one_world(sim, real):
        a, b = pair_matching.match_poses(sim.poses, real.poses, tolerance, progress)
    else:
        parts = [(np.empty(0, dtype=np.intp),) * 2]
        for rows, others in _trajectory_pairs(sim, real):
            if isinstance(tolerance, PoseTolerance):
                a, b = pair_matching.match_poses(sim.poses[rows], real.poses[others], tolerance)
            elif tolerance is not None:
                a, b = pair_matching.match_times(sim.times[rows], real.times[others], tolerance)
            else:
                a, b = _match_names(sim, real, rows, others, issues)
            parts.append((rows[a], others[b]))
            progress(len(rows) + len(others))
        a, b = (np.concatenate(each) for each in zip(*parts, strict=True))
    if match == "time":
        issues += _timeless(sim, real)
    order = np.argsort(b, kind="stable")
    return paired(sim, real, a[order], b[order], issues)


def paired(
    sim: RecordedSide, real: RecordedSide, a: Rows, b: Rows, issues: list[InputIssue]
) -> Pairing:
    """The pairs of some images, with their offsets."""
    apart = sim.poses[a] - real.poses[b]
    turned = angles.distance(sim.poses[a, 2], real.poses[b, 2])
    return Pairing(
        a, b, np.hypot(apart[:, 0], apart[:, 1]), np.degrees(turned),
        np.abs(sim.times[a] - real.times[b]), issues,
    )  # fmt: skip


def _have_one_world(sim: RecordedSide, real: RecordedSide) -> bool:
    return sim.recording.has_one_world and real.recording.has_one_world


def _trajectory_pairs(sim: RecordedSide, real: RecordedSide) -> Iterator[tuple[Rows, Rows]]:
    """The images of trajectories that belong together. Raises RequestError if there are none."""
    names = [(name, name) for name in sim.names if name in real.names]
    if len(sim.names) == len(real.names) == 1:
        names = [(sim.names[0], real.names[0])]
    if not names:
        raise RequestError(
            f"{sim.recording.name}, {real.recording.name}: no trajectory of the same name (sim: "
            f"{', '.join(sim.names[:5])}; real: {', '.join(real.names[:5])}); choose one each by "
            "--sim-trajectory and --real-trajectory"
        )
    for own, other in names:
        yield (
            np.flatnonzero(sim.codes == sim.names.index(own)),
            np.flatnonzero(real.codes == real.names.index(other)),
        )


def _match_names(
    sim: RecordedSide, real: RecordedSide, rows: Rows, others: Rows, issues: list[InputIssue]
) -> tuple[Rows, Rows]:
    """The places in `rows` and `others` of images of equal names; a repeated name has no pair."""
    places: list[dict[str, int]] = []
    for side, numbers in ((sim, rows), (real, others)):
        stems = [PurePosixPath(side.image(int(number))).stem for number in numbers]
        counts = Counter(stems)
        places.append({stem: place for place, stem in enumerate(stems) if counts[stem] == 1})
        issues += [
            InputIssue(
                "name not unique", side.image(int(number)), f"{counts[stem]} images {stem}"
            ).of_side(side.side)
            for number, stem in zip(numbers, stems, strict=True)
            if counts[stem] > 1
        ]
    common = [stem for stem in places[0] if stem in places[1]]
    found = ([place[stem] for stem in common] for place in places)
    a, b = (np.array(each, dtype=np.intp) for each in found)
    return a, b


def _timeless(sim: RecordedSide, real: RecordedSide) -> list[InputIssue]:
    """Issues for sides with images that have no time."""
    issues = []
    for side in (sim, real):
        count = int(np.count_nonzero(~np.isfinite(side.times)))
        if count:
            detail = f"{count} of {len(side)} images; they cannot be matched by time"
            issue = InputIssue("no time", side.recording.name, detail)
            issues.append(issue.of_side(side.side))
    return issues


@dataclass(frozen=True, slots=True)
class UnmatchedImage:
    """An image without partner, and what is nearest to it on the other side.

    `metres` and `degrees` are to the image of the nearest pose, or `seconds` to that of the nearest
    time; NaN where there is none. `is_paired` tells whether that image has a partner.
    """

    side: Side
    image: str
    nearest: str
    metres: float
    degrees: float
    seconds: float
    is_paired: bool

    def issue(self) -> InputIssue:
        """The image as an issue, with the nearest one in words."""
        if math.isfinite(self.seconds):
            distance = f"{self.seconds:.3f} s"
        elif math.isfinite(self.metres):
            distance = f"{self.metres:.2f} m, {self.degrees:.1f} degrees"
        else:
            return InputIssue(
                f"unmatched {self.side} image", self.image, "no image to compare with"
            )
        more = ", which is paired" if self.is_paired else ""
        detail = f"nearest {self.nearest} ({distance}){more}"
        return InputIssue(f"unmatched {self.side} image", self.image, detail)


def unmatched_images(
    sim: RecordedSide, real: RecordedSide, pairing: Pairing, match: Match
) -> Iterator[UnmatchedImage]:
    """All images without partner, sim ones first."""
    sides = {"sim": sim, "real": real}
    for side in SIDES:
        own, other = sides[side], sides["real" if side == "sim" else "sim"]
        free = pairing.unmatched(side, len(own))
        is_paired = np.zeros(len(other), dtype=np.bool_)
        is_paired[pairing.real if side == "sim" else pairing.sim] = True
        if match == "time":
            near = _nearest_in_time(own, other, free)
        else:
            near = _nearest_in_space(own, other, free)
        for number, (row, metres, degrees, seconds) in zip(free.tolist(), near, strict=True):
            name, paired = ("", False) if row < 0 else (other.image(row), bool(is_paired[row]))
            yield UnmatchedImage(
                own.side, own.image(number), name, metres, degrees, seconds, paired
            )


_Near = Iterator[tuple[int, float, float, float]]


def _nearest_in_space(own: RecordedSide, other: RecordedSide, numbers: Rows) -> _Near:
    """In worlds of their own, trajectories are compared with those that they belong to."""
    found = np.full((len(own), 3), [-1.0, math.nan, math.nan])
    groups = [(np.arange(len(own)), np.arange(len(other)))]
    if not _have_one_world(own, other):
        groups = list(_trajectory_pairs(own, other))
    for rows, others in groups:
        chosen = np.intersect1d(rows, numbers)
        if others.size:
            near = pair_matching.nearest_poses(own.poses[chosen], other.poses[others])
            found[chosen] = np.column_stack([others[near[0]], near[1], np.degrees(near[2])])
    return ((int(row), m, d, math.nan) for row, m, d in found[numbers].tolist())


def _nearest_in_time(own: RecordedSide, other: RecordedSide, numbers: Rows) -> _Near:
    known = np.flatnonzero(np.isfinite(other.times))
    order = known[np.argsort(other.times[known], kind="stable")]
    times, own_times = other.times[order], own.times[numbers]
    for time, row in zip(own_times, nearest_times(own_times, times, np.inf), strict=True):
        if row < 0:
            yield -1, math.nan, math.nan, math.nan
        else:
            yield int(order[row]), math.nan, math.nan, abs(float(times[row] - time))

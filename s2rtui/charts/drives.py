"""The drives view: the logs of the robot and of its simulator, played over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.language.canonical_text import quoted
from s2rstore.reader import Store
from s2rstore.records import SIDES, Bounds, Side
from s2rstore.security.printable_text import printable
from s2rtui.analysis.binning import Bools
from s2rtui.canvas import PlotArea, Point
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.planes import map_plot
from s2rtui.charts.view import Pane, StatisticsView, Table
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plane_marks import Poses, ScaleBar, Signs
from s2rtui.drawing.plot import Line, Mark, Phrase, Plot, Rule
from s2rtui.drawing.scale import Scale, non_empty
from s2rtui.drawing.table import Cell, Column, Row, TableSpec
from s2rtui.session import view_settings
from s2rtui.session.session import Session
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rtools.motion_logs.motion_log import Drive

Series = NDArray[np.float64]
STEP = 0.2
"""Seconds of a drive that are played at once."""
NAMES = ("drive", "seconds", "travel_m", "ape_m", "largest_m", "end_m", "untuned_ape_m")
_COLUMNS = (
    Column("drive"), Column("s", right=True, rank=1), Column("travel m", right=True, rank=1),
    Column("APE m", right=True), Column("largest m", right=True, rank=2),
    Column("end m", right=True, rank=2), Column("untuned m", right=True, rank=3),
)  # fmt: skip
_PATH, _TIME = "path", "distance"
_MARGIN = 0.5
"""Metres around the paths."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A drive at the times of its real log, seconds (n,) since its start.

    real, sim: poses x, y, heading (n, 3), metres and radians, sim NaN where its log does not reach.
    distances: metres (n,) between the real and another log by its name, `sim` and perhaps
    `untuned`. trajectory: whether the drive is a trajectory of the store, with its odometry as sim.
    """

    name: str
    time: Series
    real: Series
    sim: Series
    distances: dict[str, Series]
    trajectory: bool

    @classmethod
    def of(cls, drive: Drive) -> Track:
        from s2rtools.motion_logs.motion_log import poses_at

        at = drive.real.time
        real, sim = (np.stack(poses_at(log, at), axis=1) for log in (drive.real, drive.sim))
        others = {"sim": sim}
        if drive.untuned is not None:
            others["untuned"] = np.stack(poses_at(drive.untuned, at), axis=1)
        distances: dict[str, Series] = {
            name: np.hypot(poses[:, 0] - real[:, 0], poses[:, 1] - real[:, 1])
            for name, poses in others.items()
        }
        time = np.asarray(at - at[0], dtype=np.float64)
        return cls(printable(drive.name), time, real, sim, distances, drive.odometry is not None)

    @property
    def seconds(self) -> float:
        return float(self.time[-1])

    @property
    def travel(self) -> float:
        """Metres that the robot drove."""
        return float(np.hypot(*np.diff(self.real[:, :2], axis=0).T).sum())

    def figures(self) -> tuple[float | None, ...]:
        """The numbers of `NAMES` behind the name; None where no other log reaches."""
        known = {name: each[np.isfinite(each)] for name, each in self.distances.items()}
        ape = {name: float(np.sqrt(np.mean(each**2))) if each.size else None
               for name, each in known.items()}  # fmt: skip
        ends = (float(known["sim"].max()), float(known["sim"][-1])) if known["sim"].size else None
        return (self.seconds, self.travel, ape["sim"], *(ends or (None, None)), ape.get("untuned"))

    def index(self, moment: float) -> int:
        """The pose at a moment, the last one that is not later."""
        return max(int(np.searchsorted(self.time, moment + 1e-9, side="right")) - 1, 0)


@dataclass(frozen=True, slots=True, eq=False)
class Drives:
    """The drives of a store, and what is wrong with those that cannot be read."""

    tracks: tuple[Track, ...]
    problems: tuple[str, ...] = ()


class DrivesView(StatisticsView):
    name = "drives"
    key = '"'
    pane: Pane = "centre"
    description = "drives: logs of the robot and its simulator over time"
    about = "' plays, <- -> moves in time"
    title = "drives in reality and in simulation"
    counts_instances = False
    needs_poses = False
    needs_run = False
    figure_size = (1600, 1300)

    def model(self, store: Store, state: State) -> Drives | str:
        from s2rtools.motion_logs.drives import odometry

        folder = None if store.files.is_remote else store.path / "drives"
        has_logs = folder is not None and folder.is_dir()
        try:
            if folder is not None and has_logs:
                return _read(folder, _stamp(folder))
            return Drives(tuple(map(Track.of, odometry(store))))
        except RequestError as error:
            none = "no folder of drives (drives/NAME/real.csv and sim.csv) in the store; "
            if folder is None:
                none = "drives in a folder are read from stores on this machine; "
            return printable(f"{'' if has_logs else none}{error}")

    def choices(self, model: Drives, side: Side) -> Sequence[tuple[str, str]]:
        return [(each.name, f"traj:{quoted(each.name)}" if each.trajectory else "")
                for each in model.tracks]  # fmt: skip

    def table(self, model: Drives) -> TableSpec:
        has_untuned = any("untuned" in each.distances for each in model.tracks)
        columns = _COLUMNS if has_untuned else _COLUMNS[:-1]
        rows = []
        for each in model.tracks:
            texts = ["-" if number is None else f"{number:.2f}" for number in each.figures()]
            rows.append(Row((Cell(each.name), *map(Cell, texts[: len(columns) - 1]))))
        return TableSpec(columns, tuple(rows))

    def notes(self, model: Drives) -> tuple[str, ...]:
        return model.problems

    def numbers(self, scene: Scene) -> Table:
        model = self.input(scene)
        rows = [] if isinstance(model, str) else [(t.name, *t.figures()) for t in model.tracks]
        return NAMES, rows

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        return (*super().cache_key(scene), scene.state.moment)

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        drawn, track = super().drawing(scene, columns), self.chosen(scene)
        at = track.index(scene.state.moment)
        now = f"{track.time[at]:.1f} of {track.seconds:.1f} s"
        for name, distance in track.distances.items():
            if np.isfinite(distance[at]):
                now += f", {name} {distance[at]:.2f} m away"
        title = (Phrase(track.name, "text"), Phrase("real", "real", "real"),
                 Phrase("odometry" if track.trajectory else "sim", "sim", "sim"))  # fmt: skip
        plots = (_path(track, at, title), _distance(track, at))
        return replace(drawn, plots=plots, notes=(now, *drawn.notes), beside=True)

    def chosen(self, scene: Scene) -> Track:
        """The drive of the chosen row, by default the first one."""
        tracks: Sequence[Track] = self.input(scene).tracks
        named = scene.state.chosen_row(self.name)
        return next((each for each in tracks if each.name == named), tracks[0])

    def heading(self, scene: Scene) -> tuple[str, str]:
        return self.title, scene.store.dataset.name

    def play(self, session: Session, scene: Scene, steps: int) -> bool:
        """Move in time by steps of `STEP`; False where the drive begins or ends."""
        if self.missing(scene):
            return False
        last = self.chosen(scene).seconds
        present = min(scene.state.moment, last)
        moment = min(max(present + steps * STEP, 0.0), last)
        session.dispatch(view_settings.set_moment, moment)
        return moment != present

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        if panel.name == _TIME:
            session.dispatch(view_settings.set_moment, max(point[0], 0.0))
        elif panel.name == self.name:
            super().click(session, scene, panel, point)


def _stamp(folder: Path) -> tuple[object, ...]:
    """What changes when a log is written."""
    stats = ((path, path.lstat()) for path in sorted([*folder.glob("*"), *folder.glob("*/*")]))
    return tuple((path, stat.st_mtime_ns, stat.st_size) for path, stat in stats)


@lru_cache(2)
def _read(folder: Path, stamp: tuple[object, ...]) -> Drives:
    """Read the drives of a folder; they are cached by `stamp`.

    Raises RequestError where none can be read.
    """
    from s2rtools.motion_logs.drives import drive_folders, read_drive

    tracks, problems = [], []
    for path in drive_folders(folder):
        try:
            tracks.append(Track.of(read_drive(path)))
        except RequestError as error:
            problems.append(printable(str(error)))
    if not tracks:
        raise RequestError("; ".join(problems))
    return Drives(tuple(tracks), tuple(problems))


def _path(track: Track, at: int, title: tuple[Phrase, ...]) -> Plot:
    """Both paths, with arrows where robot and simulator are."""
    every = np.concatenate([track.real[:, :2], track.sim[:, :2]])
    every = every[np.isfinite(every).all(axis=1)]
    (x0, y0), (x1, y1) = every.min(axis=0) - _MARGIN, every.max(axis=0) + _MARGIN
    marks: list[Mark] = [ScaleBar()]
    places: list[Mark] = []
    for side, poses in zip(SIDES, (track.sim, track.real), strict=True):
        known: Bools = np.isfinite(poses[:, 0])
        marks.append(Signs(poses[:, 0], poses[:, 1], known, known, side, side))
        if known[at]:
            x, y, heading = poses[at].tolist()
            places.append(Poses(((x, y, heading),), "cursor", side))
    marks += places
    area = Bounds(float(x0), float(y0), float(x1), float(y1))
    return map_plot(marks, area, y_down=False, name=_PATH, title=title)


def _distance(track: Track, at: int) -> Plot:
    """Metres between the robot and its simulator over time."""
    x = Scale(*non_empty(0.0, track.seconds), ("time (s)", "s"))
    highest = max(np.nanmax(each, initial=0.0) for each in track.distances.values()) or 1.0
    y = Scale(0.0, 1.05 * float(highest), ("distance to real (m)", "distance m", "m"))
    marks: list[Mark] = [Rule(float(track.time[at]), ink="cursor")]
    if "untuned" in track.distances:
        marks.append(Line(track.time, track.distances["untuned"], "muted", "untuned", dashed=True))
    marks.append(Line(track.time, track.distances["sim"], "sim", "sim"))
    return Plot(x, y, tuple(marks), _TIME)


VIEW = DrivesView()

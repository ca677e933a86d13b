"""What the views are drawn from: plain numbers, the same for the terminal and for paper."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds, Room, Side
from s2rtui.canvas.brush import Mark
from s2rtui.session.state import MapMode

Floats = NDArray[np.floating]
Codes = NDArray[np.integer]
Bools = NDArray[np.bool_]
Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class OverviewRow:
    """One run: mean accuracies 0 .. 1 with their 95 % intervals; None or NaN: nothing is left.

    `n` counts the instances behind the numbers; `note` is shown in their place or beside them.
    """

    run: str
    sim_accuracy: float | None
    real_accuracy: float | None
    sim_interval: Interval | None = None
    real_interval: Interval | None = None
    n: int = 0
    note: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class OverviewLines:
    """Each instance as a line across the runs.

    values: a column (N,) per run, in the rows' order, accuracies of `side` (NaN: none there).
    selected, valid: (N,) bool; cursor: an iid, its own line is drawn on top with its numbers.
    """

    values: tuple[Floats, ...]
    selected: Bools
    valid: Bools
    side: Side = "real"
    cursor: int | None = None


@dataclass(frozen=True, slots=True)
class LivePose:
    """A prediction that is not stored: metres, radians."""

    side: Side
    x: float
    y: float
    heading: float


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """What lies under the points of a map.

    floor_plan: (H, W, 3) uint8 over `bounds`, its first row drawn at the top. heat and clip:
    (rows, cols) over `bounds`, row 0 at bounds.y0; heat is NaN where nothing is, and where clip
    is False, 0 or NaN (no selected instance has seen it) the ground is dimmed.
    """

    bounds: Bounds
    y_down: bool = True
    floor_plan: NDArray[np.uint8] | None = None
    heat: Floats | None = None
    heat_range: Interval | None = None
    clip: Floats | Bools | None = None
    rooms: tuple[Room, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class GeoMapInput:
    """The map of one run.

    truth, sim, real: (N, 2) metres. values: (N,) what mode "colour" shows, NaN for none;
    `value_label` and `value_unit` name it, `value_range` fixes its scale (default: the 1st ..
    99th percentile of the valid). selected, valid: (N,) bool; cursor: an iid. headings, (N,)
    radians: the truth's. floor_plan, heat, clip: see `Ground`. Columns are taken as never changed
    in place: what is worked out of them is kept for as long as the same arrays are given. `live`
    are predictions for the cursor that no column has.
    """

    truth: Floats
    sim: Floats
    real: Floats
    values: Floats
    selected: Bools
    valid: Bools
    bounds: Bounds
    headings: Floats | None = None
    sim_headings: Floats | None = None
    real_headings: Floats | None = None
    cursor: int | None = None
    y_down: bool = True
    mode: MapMode = "colour"
    value_label: str = "shift"
    value_unit: str = "m"
    value_range: Interval | None = None
    floor_plan: NDArray[np.uint8] | None = None
    heat: Floats | None = None
    heat_label: str = "heat"
    heat_unit: str = ""
    heat_range: Interval | None = None
    clip: Floats | Bools | None = None
    rooms: tuple[Room, ...] = ()
    room_names: bool = True
    mark: Mark | None = None
    live: tuple[LivePose, ...] = ()

    @property
    def ground(self) -> Ground:
        rooms = self.rooms if self.room_names else ()
        return Ground(
            self.bounds,
            self.y_down,
            self.floor_plan,
            self.heat,
            self.heat_range,
            self.clip,
            rooms,
        )


@dataclass(frozen=True, slots=True, eq=False)
class DifferenceInput:
    """Two runs on one map: which of them errs more, and where.

    truth: (N, 2) metres. first, second: (N,) errors of the two runs in `unit`, NaN where one has
    none; `names` are the runs', `side` tells whose errors they are. Differences are first -
    second, so above 0 the second is better; within `equal` they count as equal. `scale`: the
    difference of full colour (default: the 99th percentile of the valid). The rest as in
    `GeoMapInput`.
    """

    truth: Floats
    first: Floats
    second: Floats
    selected: Bools
    valid: Bools
    bounds: Bounds
    names: tuple[str, str] = ("first", "second")
    side: Side = "real"
    unit: str = "m"
    equal: float = 0.05
    scale: float | None = None
    cursor: int | None = None
    y_down: bool = True
    floor_plan: NDArray[np.uint8] | None = None
    clip: Floats | Bools | None = None
    rooms: tuple[Room, ...] = ()
    room_names: bool = True
    mark: Mark | None = None

    @property
    def ground(self) -> Ground:
        rooms = self.rooms if self.room_names else ()
        return Ground(self.bounds, self.y_down, self.floor_plan, clip=self.clip, rooms=rooms)


@dataclass(frozen=True, slots=True)
class PoseNumbers:
    """A predicted pose with its errors: metres and radians, NaN where unknown."""

    x: float
    y: float
    heading: float
    error: float = float("nan")
    heading_error: float = float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class SideView:
    """One side of an instance.

    rgb: (H, W, 3) uint8, (0, 0, 3) for none. depth: (H, W) metres, NaN where invalid. heat: (h, w)
    over the whole image, any resolution, NaN for none. pose: the prediction on this side.
    """

    rgb: NDArray[np.uint8]
    depth: Floats | None = None
    heat: Floats | None = None
    pose: PoseNumbers | None = None
    title: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class InstanceInput:
    """One instance, sim beside real.

    `kind` (and `mode`) name the heat, `signed` makes its scale diverge about 0, `heat_range`
    fixes it (default: from both sides together), `over` is the row of pictures that the heat
    lies on. `truth`: x, y in metres, heading in radians. `notes`: further lines, label and value.
    """

    iid: int
    sim: SideView
    real: SideView
    truth: tuple[float, float, float] | None = None
    kind: str | None = None
    mode: str | None = None
    unit: str = ""
    signed: bool = False
    heat_range: Interval | None = None
    over: Literal["rgb", "depth", "both"] = "rgb"
    depth_range: Interval | None = None
    notes: tuple[tuple[str, str], ...] = field(default=())


@dataclass(frozen=True, slots=True, eq=False)
class HistogramInput:
    """Errors of both sides, (N,) each, in `unit`; `selected` and `valid` (N,) bool; cursor: an iid.

    `upper` is the right end of the axis (default: the 99th percentile of both sides).
    """

    sim: Floats
    real: Floats
    selected: Bools
    valid: Bools
    label: str = "error"
    unit: str = "m"
    upper: float | None = None
    cursor: int | None = None
    mark: Mark | None = None


@dataclass(frozen=True, slots=True, eq=False)
class UmapInput:
    """Embeddings in the plane, sim and real in the same coordinates.

    sim, real: (N, 2), NaN for none. values: (N,) what colours the points, NaN for none (default:
    the distance between an instance's two points); `value_range` fixes its scale (default: the 1st
    .. 99th percentile). selected, valid: (N,) bool; cursor: an iid.
    """

    sim: Floats
    real: Floats
    values: Floats | None
    selected: Bools
    valid: Bools
    cursor: int | None = None
    mark: Mark | None = None
    value_label: str = "distance"
    value_unit: str = ""
    value_range: Interval | None = None


@dataclass(frozen=True, slots=True, eq=False)
class OrientationInput:
    """Headings of prediction, truth and prediction, (N,) radians each, NaN for none.

    selected, valid: (N,) bool; cursor: an iid. `y_down`: 90 degrees points down on the screen.
    """

    sim: Floats
    truth: Floats
    real: Floats
    selected: Bools
    valid: Bools
    y_down: bool = True
    cursor: int | None = None
    mark: Mark | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RoomsInput:
    """The rooms of prediction, truth and prediction: (N,) indices into `room_names`, -1 for none.

    selected, valid: (N,) bool; cursor: an iid.
    """

    sim: Codes
    truth: Codes
    real: Codes
    room_names: tuple[str, ...]
    selected: Bools
    valid: Bools
    cursor: int | None = None
    mark: Mark | None = None

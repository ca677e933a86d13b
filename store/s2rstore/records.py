"""Records of the index: one class per table that is read as a whole.

The types of the fields state which values the rows of an index may have; `index.row_records` makes
records of rows.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Literal

from msgspec import Meta

from s2rstore.errors import RequestError

MAX_COORDINATE = 1e6
"""Metres from the origin that bounds and rooms may reach."""
MAX_LABEL = 65_535
"""Largest value of a pixel of a label image."""
MAX_TEXT = 1_000

HASH = r"\A[0-9a-f]{16,64}\Z"
NAME = r"\A(?!.*\.\.)[A-Za-z0-9][A-Za-z0-9_.+-]{0,79}\Z"
"""What a name matches that can name a folder and stand in an expression."""
Hash = Annotated[str, Meta(pattern=HASH)]
Name = Annotated[str, Meta(pattern=NAME)]
Text = Annotated[str, Meta(min_length=1, max_length=MAX_TEXT)]
Metres = Annotated[float, Meta(ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Scale = Annotated[float, Meta(ge=1e-6, le=2 * MAX_COORDINATE)]
Pixels = Annotated[float, Meta(ge=-1e7, le=1e7)]
FocalLength = Annotated[float, Meta(ge=1e-6, le=1e7)]
Angle = Annotated[float, Meta(ge=-math.pi, le=math.pi)]
DepthScale = Annotated[float, Meta(ge=1e-12, le=1e6)]
Count = Annotated[int, Meta(ge=0, le=2**31 - 1)]
ImageSide = Annotated[int, Meta(ge=1, le=16_384)]
"""Rows or columns of a stored frame, or of the input of a model."""
Level = Annotated[float, Meta(ge=-1e9, le=1e9)]
Kind = Annotated[str, Meta(pattern=r"\A[a-z][a-z0-9_:]{0,79}\Z")]
DataType = Literal[
    "uint8", "uint16", "int8", "int16", "int32", "float16", "float32", "float64",
]  # fmt: skip

Side = Literal["sim", "real"]
SIDES: tuple[Side, Side] = ("sim", "real")

Direction = Literal["sim2real", "real2sim"]
DIRECTIONS: tuple[Direction, Direction] = ("sim2real", "real2sim")

Split = Literal["train", "validation", "test", "unseen"]
SPLITS: tuple[Split, ...] = ("train", "validation", "test", "unseen")
GAP_FACTORS = ("lighting", "depth", "objects", "sensor", "camera")
"""The factors that the gap of an image pair is shared out to."""
TRAINING_SPLITS: tuple[Split, ...] = ("train", "validation")
"""The splits of images that a model was fitted or chosen on; they come first in `SPLITS`."""

ARCHIVES = ("torchscript", "torch.export")
"""Architectures whose weights file holds the network, too."""
NO_RUN = ""
"""Stands for the run in a store without a computed run, whose images can be browsed."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """The floor plan's rectangle in map coordinates, metres."""

    x0: Metres
    y0: Metres
    x1: Metres
    y1: Metres

    @property
    def width(self) -> float:
        return self.x1 - self.x0

    @property
    def height(self) -> float:
        return self.y1 - self.y0

    @property
    def diagonal(self) -> float:
        return float((self.width**2 + self.height**2) ** 0.5)


RecallThresholds = tuple[tuple[float, float], ...]
RECALL_THRESHOLDS: RecallThresholds = ((0.25, 2.0), (0.5, 5.0), (1.0, 10.0), (2.0, 20.0))
"""Pairs of metres and degrees within which recall counts a prediction, by default."""


@dataclass(frozen=True, slots=True)
class Dataset:
    """One environment. `accuracy_scale` is S of `accuracy = max(0, 1 - error / S)`, metres.

    `recall_thresholds` are pairs of metres and degrees, ascending, of recall.

    Without poses (`has_poses` false) it is a set of images: there are no depth, no cameras, no map
    and no runs; `bounds` and `accuracy_scale` are NaN.
    """

    name: Text
    hash: Hash
    bounds: Bounds
    y_down: bool
    floor_plan: Text | None
    accuracy_scale: Scale
    frame_height: ImageSide
    frame_width: ImageSide
    has_poses: bool = True
    recall_thresholds: RecallThresholds = RECALL_THRESHOLDS


@dataclass(frozen=True, slots=True)
class Trajectory:
    trajectory: Name
    recorded_at: Text | None
    instances: Count


@dataclass(frozen=True, slots=True)
class Room:
    """An axis-aligned rectangle; the first by `position` wins where rooms overlap."""

    room: Text
    position: Count
    x0: Metres
    y0: Metres
    x1: Metres
    y1: Metres


@dataclass(frozen=True, slots=True)
class Label:
    """A class of objects: the value of its pixels in label images, and its name."""

    label: Annotated[int, Meta(ge=1, le=MAX_LABEL)]
    name: Text


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole in continuous image coordinates of the stored frame.

    Pixel `i` covers [i, i + 1), so its centre is i + 0.5. Focal lengths and the principal point
    are in pixels of the stored frame; `pitch` is in radians, positive upwards.
    """

    fx: FocalLength
    fy: FocalLength
    cx: Pixels
    cy: Pixels
    pitch: Angle = 0.0


@dataclass(frozen=True, slots=True)
class Domain:
    """One source of images of every instance, with its cameras.

    In a data set without poses it images some trajectories only; figures of cameras and depth are
    NaN, and the range of valid depth is empty (1 .. 0). Without depth (`has_depth` false) this
    holds for the figures of depth.

    `camera_height` (metres above the floor) and `forward_offset` (metres ahead of the pose,
    negative behind it) hold for both cameras. Metres = raw depth value * `depth_scale`; a raw
    value is valid within `depth_raw_min` .. `depth_raw_max`, both included. `sources` states for
    each group of figures whether it was `declared` or `estimated`.
    """

    domain: Name
    kind: Side
    rgb: Intrinsics
    depth: Intrinsics
    camera_height: Metres
    forward_offset: Metres
    depth_scale: DepthScale
    depth_raw_min: Count
    depth_raw_max: Count
    sources: dict[str, str] = field(default_factory=dict)
    has_depth: bool = True

    def facts(self) -> dict[str, Any]:
        """The fields as plain values for a hash; `has_depth` only where it is false."""
        facts = asdict(self)
        if self.has_depth:
            del facts["has_depth"]
        return facts


@dataclass(frozen=True, slots=True)
class Coverage:
    """For how many of a store's instances a run is computed; appended ones may be missing.

    `instances` are those with images in both domains of the run, `not_imaged` the others;
    `not_predicted` of these have an image of one side, but no prediction of it. Of a run whose
    predictions were imported, `computed` is to how many instances both sides were applied;
    `not_localised` of these have no pose on one of the sides.
    """

    run: str
    computed: int
    instances: int
    is_imported: bool = False
    not_localised: int = 0
    not_imaged: int = 0
    not_predicted: int = 0

    @property
    def is_partial(self) -> bool:
        """Whether the run is computed for some instances, but not for all."""
        return 0 < self.computed < self.instances

    @property
    def is_outdated(self) -> bool:
        """Whether `s2r precompute` would predict further images of the run."""
        return self.computed > 0 and (self.is_partial or self.not_predicted > 0)

    @property
    def summary(self) -> str:
        """`computed for 40 of 45 instances`; unless that is partial, `imported` or empty.

        Instances that were not localised follow, and those without images in both domains:
        `imported, 5 not localised`, `50 instances have no image on one side`.
        """
        verb = "imported" if self.is_imported else "computed"
        text = f"{verb} for {self.computed} of {self.instances} instances"
        text = text if self.is_partial else "imported" * self.is_imported
        lost = f"{self.not_localised} not localised" if self.not_localised else ""
        plural = "instance has" if self.not_imaged == 1 else "instances have"
        lacking = f"{self.not_imaged} {plural} no image on one side"
        if self.not_predicted:
            lacking += f" ({self.not_predicted} not predicted)"
        return ", ".join(filter(None, (text, lost, lacking if self.not_imaged else "")))

    @property
    def note(self) -> str:
        """A line about a run that does not have all instances, each with both poses; or empty."""
        advice = "; `s2r precompute` computes the others"
        if self.is_imported:
            advice = "; the others have no prediction on both sides"
        if not (self.is_partial or self.not_localised or self.not_imaged):
            return ""
        return f"run {self.run}: {self.summary}{advice if self.is_outdated else ''}"


@dataclass(frozen=True, slots=True)
class Part:
    """Instances [`first_iid`, `stop`) that were ingested together; they never change.

    `hash` is that of their poses, frames and calibration; `added_at` is UTC, ISO 8601.
    """

    part: Count
    first_iid: Count
    instances: Count
    hash: Hash
    added_at: Text | None = None

    @property
    def stop(self) -> int:
        return self.first_iid + self.instances

    @property
    def iids(self) -> range:
        return range(self.first_iid, self.stop)


@dataclass(frozen=True, slots=True)
class TrajectoryPart:
    """Instances [`first_iid`, `stop`) of a trajectory: those that belong to one part of the store.

    `row` is the position of the first of them in the trajectory.
    """

    trajectory: str
    part: int
    first_iid: int
    instances: int
    row: int

    @property
    def stop(self) -> int:
        return self.first_iid + self.instances

    @property
    def folder(self) -> str:
        """The folder of their frames in that of a domain."""
        return self.later_folder(self.trajectory, self.part) if self.row else self.trajectory

    @staticmethod
    def later_folder(trajectory: str, part: int) -> str:
        """The folder of instances that follow others; names of trajectories hold no `@`."""
        return f"{trajectory}@{part}"


@dataclass(frozen=True, slots=True)
class Model:
    """A network in the store; `input` is its input contract."""

    model: Name
    architecture: Text
    sha256: Hash
    input_height: ImageSide
    input_width: ImageSide
    convention: str
    trained_by: Annotated[str, Meta(min_length=1, max_length=100_000)] | None
    input: dict[str, Any]

    @property
    def needs_trust(self) -> bool:
        """Whether loading it executes code that comes with it."""
        return self.architecture in ARCHIVES or ":" in self.architecture

    @property
    def channels(self) -> str:
        """What the network sees: `rgb`, `depth` or `rgbd`."""
        return str(self.input["channels"])


@dataclass(frozen=True, slots=True)
class TranslatorRecord:
    """A fitted translator: a map from images of `source_domain` to the look of `target_domain`.

    `accepted` is None until its content was checked; `reasons` say why it is not accepted.
    """

    translator: Name
    method: Name
    direction: Direction
    source_domain: Name
    target_domain: Name
    sha256: Hash
    accepted: bool | None
    reasons: tuple[str, ...]
    created_at: Text

    @property
    def side(self) -> Side:
        """The side whose images it translates."""
        return "sim" if self.direction == "sim2real" else "real"


@dataclass(frozen=True, slots=True)
class Run:
    """One model applied to one sim and one real domain, each with its adjustments.

    An adjustment chain is a list of `{"name": ..., "value": ...}`; empty means untouched. `key`
    is None until the run has been computed. `model` is None where the predictions were imported.
    """

    run: Name
    model: Name | None
    sim_domain: Name
    real_domain: Name
    sim_adjustments: list[dict[str, Any]]
    real_adjustments: list[dict[str, Any]]
    key: Name | None
    precision: Text | None
    created_at: Text

    def domain(self, side: Side) -> str:
        return self.sim_domain if side == "sim" else self.real_domain

    def adjustments(self, side: Side) -> list[dict[str, Any]]:
        return self.sim_adjustments if side == "sim" else self.real_adjustments

    @property
    def is_imported(self) -> bool:
        """Whether its predictions were imported, so that there is no network to run."""
        return self.model is None

    @property
    def embedding_command(self) -> str:
        """The command that gives the run embeddings."""
        return "`s2r run import --embeddings`" if self.is_imported else "`s2r precompute`"

    def network(self, purpose: str) -> str:
        """The name of its model. Raises RequestError for imported predictions.

        `purpose`, which begins the reason, needs the network.
        """
        if self.model is None:
            raise RequestError(needs_network(self.run, purpose))
        return self.model


def needs_network(run: str, purpose: str) -> str:
    """Why something that runs a network cannot be done for a run of imported predictions."""
    return f"run {run!r}: its predictions were imported; {purpose} needs a network"


@dataclass(frozen=True, slots=True)
class ArrayRecord:
    """One published Zarr array of a run, for the instances from `first_iid` on.

    `side` is None where both sides share it. Real value = (stored - zero) * scale. `path` is
    relative to `runs.zarr`. `metadata_sha256` is that of its `zarr.json`.
    """

    run: str
    kind: Kind
    side: Side | None
    mode: Kind | None
    path: Text
    dtype: DataType
    shape: tuple[Count, ...]
    axes: tuple[str, ...]
    scale: Level
    zero: Level
    unit: str
    metadata_sha256: Hash
    first_iid: Count = 0

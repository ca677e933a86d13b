"""The fields, words and functions of the language; a new field takes one line here."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.index.columns import InstanceColumns, RunColumns
from s2rstore.index.pair_view import column_name as pair_column
from s2rstore.records import GAP_FACTORS, SIDES, Side


@dataclass(frozen=True, slots=True)
class Numeric:
    """A field of numbers: `column` in view `pair`, `path` in the dense columns.

    `scale` converts `unit` to that of the index. `angle` marks values whose ranges wrap around.
    """

    column: str
    path: str
    unit: str
    description: str
    scale: float = 1.0
    angle: bool = False


@dataclass(frozen=True, slots=True)
class Text:
    """A field of names: `path` of codes, and `column` in view `pair`.

    Rooms of predictions, the split of both sides together, and `has`, `label` and `health`, which
    hold for several names, have no column.
    """

    column: str
    path: str
    vocabulary: str
    description: str


_DEGREE = math.pi / 180

_SIDE_NUMERIC: tuple[tuple[Any, ...], ...] = (
    ("error", "m", "distance to the ground truth"),
    ("heading_error", "degrees", "angle to the ground truth", _DEGREE),
    ("loss", "", "0.7 error^2 + 0.3 heading error in radians"),
    ("accuracy", "", "1 - error / accuracy scale, at least 0"),
    ("rank", "", "by error among the instances that count, 1 = smallest"),
    ("outlier", "", "distance to its nearest embeddings, 1 = the side's median"),
    ("x", "m", "predicted position"),
    ("y", "m", "predicted position"),
    ("heading", "degrees", "predicted heading", _DEGREE, True),
    ("sigma", "m", "stated standard deviation of the position per axis"),
    ("u", "", "UMAP coordinate"),
    ("v", "", "UMAP coordinate"),
)

NUMERIC: dict[str, Numeric] = {
    "iid": Numeric("iid", "iid", "", "the instance's number"),
    "seq": Numeric("seq", "instances.seq", "", "number in the trajectory"),
    "x": Numeric("x_m", "instances.x", "m", "ground truth"),
    "y": Numeric("y_m", "instances.y", "m", "ground truth"),
    "heading": Numeric(
        "heading_rad", "instances.heading", "degrees", "ground truth", _DEGREE, True
    ),
    "curvature": Numeric("curvature_deg", "instances.curvature", "degrees", "heading change"),
    "timestamp": Numeric("timestamp_s", "instances.timestamp", "s", "of the recording"),
    "pair_offset_m": Numeric(
        "pair_offset_m", "instances.pair_offset_m", "m", "between the poses of both images"
    ),
    "pair_offset_deg": Numeric(
        "pair_offset_deg",
        "instances.pair_offset_deg",
        "degrees",
        "between the headings of both images",
    ),
    "gap": Numeric("gap_m", "gap", "m", "real error - sim error"),
    "shift": Numeric("shift_m", "shift", "m", "between the sim and the real prediction"),
    **{
        f"share.{factor}": Numeric(
            f"share_{factor}_m",
            f"real.share_{factor}",
            "m",
            f"part of the gap due to {factor}",
        )
        for factor in GAP_FACTORS
    },
    **{
        f"{side}.{name}": Numeric(
            pair_column(f"{side}_{name}"), f"{side}.{name}", unit, f"{side}: {text}", *turn
        )
        for side in SIDES
        for name, unit, text, *turn in _SIDE_NUMERIC
    },
}

RANKS: dict[str, Side] = {f"{side}.rank": side for side in SIDES}
"""The fields that depend on the population, and the side that each ranks."""

TEXT: dict[str, Text] = {
    "room": Text("room", "instances.room", "rooms", "room of the ground truth"),
    "traj": Text("trajectory", "instances.trajectory", "trajectories", "trajectory"),
    "has": Text("", "instances.imaged", "domains", "domain in which the instance has an image"),
    "label": Text("", "instances.labelled", "labels", "class of an object in a label image"),
    "health": Text("", "instances.faulty", "faults", "fault of an image that s2r check found"),
    "split": Text("", "split", "splits", "what the model knew of either image"),
    **{
        f"{side}.{name}": Text(f"{side}_{name}", f"{side}.{name}", vocabulary, f"{side}: {text}")
        for side in SIDES
        for name, vocabulary, text in (
            ("room", "rooms", "room of the prediction"),
            ("split", "splits", "what the model knew of the image"),
        )
    },
}

# Prefixes of box(...), near(...) and lasso(...), with the two columns that each compares.
PLANES: dict[str, tuple[str, str]] = {
    "": ("x", "y"),
    "sim.": ("sim.x", "sim.y"),
    "real.": ("real.x", "real.y"),
    "umap.sim.": ("sim.u", "sim.v"),
    "umap.real.": ("real.u", "real.v"),
    "error.": ("sim.error", "real.error"),
}

_SHAPES = (
    ("box", "box({0}0, {1}0, {0}1, {1}1): {2} in a rectangle{3}"),
    ("near", "near({0}, {1}, radius): {2} in a circle{3}"),
    ("lasso", "lasso({0}0, {1}0, {0}1, {1}1, {0}2, {1}2, ...): {2} in a polygon{3}"),
)
_PLANE_TEXTS = {
    "": ("x", "y", "ground truth", ", m"),
    "sim.": ("x", "y", "sim predictions", ", m"),
    "real.": ("x", "y", "real predictions", ", m"),
    "umap.sim.": ("u", "v", "sim side of the UMAP", ""),
    "umap.real.": ("u", "v", "real side of the UMAP", ""),
    "error.": ("s", "r", "sim error s and real error r", ", m"),
}

FUNCTIONS: dict[str, str] = {
    "worst": "worst(20%, sim.error): the largest values",
    "best": "best(25, gap): the smallest values",
    "ids": "ids(3, 7..12): instances by number",
    "like": "like(iid, k): the k nearest by embedding, real side, and itself",
    "sim.like": "sim.like(iid, k): the k nearest by embedding, sim side, and itself",
    "real.like": "the same as like",
    "harm.label": 'harm.label("chair") > 0.2: metres that labelled objects cost the real side',
    **{
        f"{prefix}{name}": prefix + text.format(*texts)
        for name, text in _SHAPES
        for prefix, texts in _PLANE_TEXTS.items()
    },
    "umap.sim": "the same as umap.sim.box",
    "umap.real": "the same as umap.real.box",
}

WORDS: dict[str, str] = {
    "all": "every instance that counts",
    "none": "the empty set",
    "worst15": "worst(15%, real.error)",
    "best15": "best(15%, real.error)",
    "min15": "the same as worst15",
    "max15": "the same as best15",
    "straight": "heading change under 10 degrees",
    "curved": "heading change of 10 degrees or more",
    "paired": "an image in both domains of the run",
    "new": "the model was not trained on either image",
    "trained": "the model was trained on an image: split train or validation",
}

RUN_WORDS = ("worst15", "best15", "paired", "new", "trained")
"""The words that may follow `run("name").`."""


def column(path: str, instances: InstanceColumns, run: RunColumns) -> NDArray[Any]:
    """The stored column (N,) at the path of a field, in the unit of the index."""
    if path == "iid":
        return np.arange(len(instances), dtype=np.float64)
    owner: Any = run
    for part in path.split("."):
        owner = instances if part == "instances" else getattr(owner, part)
    return np.asarray(owner)


_SUFFIXES = {"m": "_m", "degrees": "_deg", "s": "_s"}


def with_unit(name: str) -> str:
    """The name of a field with its unit: `real.error_m`, `heading_deg`. Others stay as they are.

    Expressions take both names.
    """
    suffix = _SUFFIXES.get(NUMERIC[name].unit, "") if name in NUMERIC else ""
    return name if name.endswith(suffix) else name + suffix


def column_of(name: str) -> str:
    """The column of rows that holds a field, such as `real_error_m`; expressions take it, too."""
    return with_unit(name).replace(".", "_")


_FIELDS = {with_unit(name): name for name in NUMERIC}
_COLUMNS = {column_of(name): with_unit(name) for name in NUMERIC}


def without_unit(name: str) -> str:
    """The field that a name with or without unit stands for; unknown names stay as they are."""
    return _FIELDS.get(name, name)


def of_column(column: str) -> str | None:
    """The field, with its unit, that a column of rows such as `real_error_m` holds."""
    return _COLUMNS.get(column)


def of_name(name: str) -> str:
    """The field that a name with or without unit, or a column of rows, stands for."""
    return without_unit(of_column(name) or name)


def meant(name: str) -> str | None:
    """The field, with its unit, of which an unknown name is another spelling; None for none.

    `heading_rad` means `heading_deg`; `real_error` and `real.error_rad` mean `real.error_m`.
    """
    return _SPELLINGS.get(_bare(name))


def _bare(name: str) -> str:
    bare = name.lower().replace(".", "_")
    unit = next((unit for unit in _UNITS if bare.endswith(unit)), "")
    return bare.removesuffix(unit)


_UNITS = ("_m", "_deg", "_rad", "_s")
_SPELLINGS = {_bare(name): with_unit(name) for name in (*TEXT, *NUMERIC)} | {"trajectory": "traj"}


def is_truth(name: str) -> bool:
    """Whether a field belongs to the instance and does not depend on the run."""
    known = NUMERIC.get(name) or TEXT[name]
    return known.path == "iid" or known.path.startswith("instances.")

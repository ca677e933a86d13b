"""The allow-list of fields: adding one is a line here.

A numeric field has a unit of the language and a scale to the index (degrees to radians); a text
field is compared with names.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Numeric:
    """`column` in view `pair` and, as a path, in the dense columns; `scale` = index per unit.

    `angle` marks values that turn: ranges over them wrap around.
    """

    column: str
    path: str
    unit: str
    description: str
    scale: float = 1.0
    angle: bool = False


@dataclass(frozen=True, slots=True)
class Text:
    """`column` in view `pair` (`room` of a prediction is worked out), `path` of the codes."""

    column: str
    path: str
    vocabulary: str
    description: str


_DEGREE = math.pi / 180

_SIDE_NUMERIC = (
    ("error", "m", "distance to the ground truth", 1.0, False),
    ("heading_error", "degrees", "angle to the ground truth", _DEGREE, False),
    ("loss", "", "0.7 error^2 + 0.3 heading error in radians", 1.0, False),
    ("accuracy", "", "1 - error / accuracy scale, at least 0", 1.0, False),
    ("rank", "", "by error among the run's side, 1 = smallest", 1.0, False),
    ("x", "m", "predicted position", 1.0, False),
    ("y", "m", "predicted position", 1.0, False),
    ("heading", "degrees", "predicted heading", _DEGREE, True),
    ("u", "", "UMAP coordinate", 1.0, False),
    ("v", "", "UMAP coordinate", 1.0, False),
)

NUMERIC: dict[str, Numeric] = {
    "iid": Numeric("iid", "iid", "", "the instance's number"),
    "seq": Numeric("seq", "instances.seq", "", "position in the recording"),
    "x": Numeric("x", "instances.x", "m", "ground truth"),
    "y": Numeric("y", "instances.y", "m", "ground truth"),
    "heading": Numeric("heading", "instances.heading", "degrees", "ground truth", _DEGREE, True),
    "curvature": Numeric("curvature", "instances.curvature", "degrees", "heading change"),
    "timestamp": Numeric("timestamp", "instances.timestamp", "s", "of the recording"),
    "gap": Numeric("gap", "gap", "m", "real error - sim error"),
    "shift": Numeric("shift", "shift", "m", "between the sim and the real prediction"),
    **{
        f"{side}.{name}": Numeric(
            f"{side}_{name}", f"{side}.{name}", unit, f"{side}: {text}", scale, angle
        )
        for side in ("sim", "real")
        for name, unit, text, scale, angle in _SIDE_NUMERIC
    },
}

TEXT: dict[str, Text] = {
    "room": Text("room", "instances.room", "rooms", "room of the ground truth"),
    "traj": Text("trajectory", "instances.trajectory", "trajectories", "trajectory"),
    **{
        f"{side}.{name}": Text(f"{side}_{name}", f"{side}.{name}", vocabulary, f"{side}: {text}")
        for side in ("sim", "real")
        for name, vocabulary, text in (
            ("room", "rooms", "room of the prediction"),
            ("split", "splits", "what the model knew of the image"),
        )
    },
}

# Prefixes of box(...) and near(...): the two columns that each looks at.
PLANES: dict[str, tuple[str, str]] = {
    "": ("x", "y"),
    "sim.": ("sim.x", "sim.y"),
    "real.": ("real.x", "real.y"),
}
UMAP_PLANES = {"umap.sim": ("sim.u", "sim.v"), "umap.real": ("real.u", "real.v")}

FUNCTIONS: dict[str, str] = {
    "worst": "worst(20%, sim.error): the largest values",
    "best": "best(25, gap): the smallest values",
    "box": "box(x0, y0, x1, y1): ground truth in a rectangle, m",
    "near": "near(x, y, radius): ground truth in a circle, m",
    "ids": "ids(3, 7..12): instances by number",
    "sim.box": "sim predictions in a rectangle",
    "real.box": "real predictions in a rectangle",
    "sim.near": "sim predictions in a circle",
    "real.near": "real predictions in a circle",
    "umap.sim": "umap.sim(u0, v0, u1, v1): a rectangle of the UMAP",
    "umap.real": "umap.real(u0, v0, u1, v1): a rectangle of the UMAP",
}

WORDS: dict[str, str] = {
    "all": "the base population",
    "none": "the empty set",
    "worst15": "worst(15%, real.error)",
    "best15": "best(15%, real.error)",
    "min15": "the same as worst15",
    "max15": "the same as best15",
    "straight": "heading change under 10 degrees",
    "curved": "heading change of 10 degrees or more",
}

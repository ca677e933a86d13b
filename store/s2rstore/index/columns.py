"""Dense numpy columns aligned by iid, from which views and masks are computed."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES, Side

FloatColumn = NDArray[np.float64]
IntColumn = NDArray[np.int32]
BoolColumn = NDArray[np.bool_]
Read = Callable[[str], NDArray[Any]]
_UNIT = re.compile(r"_(m|s|deg|rad)\Z")


class Columns:
    """Columns as attributes, which `read` loads by name."""

    def __init__(self, read: Read) -> None:
        self._read = read

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> NDArray[Any]:
            if name.startswith("_") or name not in type(self).__annotations__:
                raise AttributeError(self._unknown(name))
            return self._read(name)

    def _names(self) -> list[str]:
        return list(type(self).__annotations__)

    def _unknown(self, name: str) -> str:
        """A message about an unknown column, which often is the name of a field with its unit."""
        bare = _UNIT.sub("", name)
        near = difflib.get_close_matches(bare, self._names(), n=1, cutoff=0.8)
        if name.startswith("_") or not near:
            return f"no column {name} (has: {', '.join(self._names())})"
        return f"no column {name}; {near[0]} is meant (radians and metres)"


class InstanceColumns(Columns):
    """Ground truth of all N instances; every array has shape (N,).

    Text columns are codes into their names; -1 is NULL. Missing numbers are NaN. x, y and the
    odometry in metres, headings in radians, curvature in degrees, timestamps in seconds.
    `pair_offset_m` and `pair_offset_deg` are the distance and the angle between the poses of the
    sim and the real image, 0 for pairs of one pose. `imaged(domain)` are the instances with an
    image in a domain, `labelled(name)` those with a label image that shows an object of a class,
    `faulty(name)` those with an image that has a fault.
    """

    x: FloatColumn
    y: FloatColumn
    heading: FloatColumn
    seq: IntColumn
    trajectory: IntColumn
    room: IntColumn
    curvature: FloatColumn
    odom_x: FloatColumn
    odom_y: FloatColumn
    odom_heading: FloatColumn
    timestamp: FloatColumn
    pair_offset_m: FloatColumn
    pair_offset_deg: FloatColumn

    def __init__(
        self,
        read: Read,
        n: int,
        trajectory_names: tuple[str, ...],
        room_names: tuple[str, ...],
        imaged: Callable[[str], BoolColumn],
        labelled: Callable[[str], BoolColumn],
        faulty: Callable[[str], BoolColumn],
    ) -> None:
        super().__init__(read)
        self._n = n
        self.imaged = imaged
        self.labelled = labelled
        self.faulty = faulty
        self.trajectory_names = trajectory_names
        self.room_names = room_names

    def __len__(self) -> int:
        return self._n


class SideColumns(Columns):
    """One run's predictions on one side; every array has shape (N,).

    Missing numbers are NaN; `rank` counts from 1 (the smallest error) with 0 for NULL; `split`
    is a code into `records.SPLITS` with -1 for NULL; `room` is the prediction's room, a code
    into `InstanceColumns.room_names` with -1 for none; u, v are the UMAP coordinates; `outlier`
    is the distance to the nearest embeddings over the side's median; `sigma` is the standard
    deviation of the position per axis that the network states. x, y, sigma, error in metres,
    heading and heading_error in radians. `share_*` of the real side are the metres of the gap that
    each factor causes; NaN for the sim side. `imaged` marks the instances with an image in the
    run's domain.
    """

    x: FloatColumn
    y: FloatColumn
    heading: FloatColumn
    sigma: FloatColumn
    error: FloatColumn
    heading_error: FloatColumn
    loss: FloatColumn
    accuracy: FloatColumn
    rank: IntColumn
    split: IntColumn
    room: IntColumn
    u: FloatColumn
    v: FloatColumn
    outlier: FloatColumn
    imaged: BoolColumn
    share_lighting: FloatColumn
    share_depth: FloatColumn
    share_objects: FloatColumn
    share_sensor: FloatColumn
    share_camera: FloatColumn


class RunColumns(Columns):
    """A run's two sides, with gap = real error - sim error and shift between predictions, metres.

    `paired` marks the instances with an image in both domains of the run, `attempted` those that
    the run was applied to on both sides, `valid` those of them that it localised on both, and
    `trained` those of which an image was used to fit or to choose the model. `split` is the first
    in `records.SPLITS` of the splits of both sides, as a code with -1 for NULL. `label_gains(name)`
    are the metres by which the real error would fall if the objects of a class looked as in
    simulation; NaN where an image shows none.
    """

    gap: FloatColumn
    shift: FloatColumn
    paired: BoolColumn
    valid: BoolColumn
    attempted: BoolColumn
    split: IntColumn
    trained: BoolColumn

    def __init__(
        self,
        read: Read,
        run: str,
        sim: SideColumns,
        real: SideColumns,
        label_gains: Callable[[str], FloatColumn],
    ) -> None:
        super().__init__(read)
        self.run = run
        self.label_gains = label_gains
        self.sim = sim
        self.real = real

    def _names(self) -> list[str]:
        sides = (f"{side}.{name}" for side in SIDES for name in SideColumns.__annotations__)
        return [*super()._names(), *sides]

    def side(self, side: Side) -> SideColumns:
        return self.sim if side == "sim" else self.real

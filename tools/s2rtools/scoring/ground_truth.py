"""Ground truth: positions of the labelled objects in views and on the floor, rendered again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.camera_offset import UNCHANGED, RenderChange
from s2rstore.geometry.floor_grid import Projector
from s2rstore.geometry.map_grid import MapGrid
from s2rstore.reader import Store
from s2rstore.records import SIDES, Domain, Side
from s2rstore.run_inputs import run_render_change
from s2rtools.common.frame_resizing import overlap_shares
from s2rtools.synthetic_world.dataset import WorldData
from s2rtools.synthetic_world.renderer import Camera

IMAGE_CELLS = 32
POSITIVE_SHARE = 0.25
REBIN = 3
"""Published grid cells along each side of a scored floor cell."""
_BATCH = 32

FloorPlane = NDArray[np.float32]
CameraMoves = dict[Side, RenderChange]
NO_CAMERA_MOVES: CameraMoves = dict.fromkeys(SIDES, UNCHANGED)


@dataclass(frozen=True, slots=True, eq=False)
class VisibleObjects:
    """Labelled objects in the views of one side's true camera.

    `cells` (N, IMAGE_CELLS, IMAGE_CELLS): whether labelled objects of either scene cover a quarter
    of the cell. `hits` and `samples` (rows, columns): number of samples per floor cell that show a
    labelled object of the side's scene, and number of all samples, projected by the true depth.
    """

    cells: NDArray[np.bool_]
    hits: FloorPlane
    samples: FloorPlane


class GroundTruth:
    """The labelled changes of a store's synthetic world in the views of its instances.

    Raises RequestError if the store is not a synthetic world, or is rendered differently now.
    """

    def __init__(self, store: Store) -> None:
        data = WorldData.of_store(store)
        if data is None:
            raise RequestError(f"{store.path}: its ground truth is unknown; `s2r ingest world` "
                               "makes data with ground truth")  # fmt: skip
        if not data.matches(store):
            raise RequestError(f"{store.path}: this version renders other images; "
                               "ingest the world again")  # fmt: skip
        self.store, self.data = store, data
        columns = store.instances
        self.poses = np.stack([columns.x, columns.y, columns.heading], axis=1)
        self.numbers = data.noise_numbers(store)
        self.changed = data.world.changed_objects(data.severities("real"))
        self._visible: dict[tuple[Side, RenderChange], VisibleObjects] = {}

    def camera_moves(self, run: str) -> CameraMoves:
        """Camera offsets of either side in a run."""
        record = self.store.run(run)
        return {side: run_render_change(self.store, record, side) for side in SIDES}

    def visible_objects(self, side: Side, move: RenderChange = UNCHANGED) -> VisibleObjects:
        """Labelled objects in the views of a side's true camera, moved by a camera offset."""
        if (side, move) not in self._visible:
            self._visible[side, move] = self._find_visible_objects(side, move)
        return self._visible[side, move]

    def _find_visible_objects(self, side: Side, move: RenderChange) -> VisibleObjects:
        camera, dataset = move_camera(self.data.camera(side), move), self.store.dataset
        fine = MapGrid(dataset.bounds)
        grid = MapGrid(dataset.bounds, max(fine.rows, fine.cols) // REBIN)
        projector = Projector(self._true_domain(side, camera), camera.frame, dataset.y_down)
        cells = []
        for start in range(0, len(self.poses), _BATCH):
            poses = self.poses[start : start + _BATCH]
            mask = np.zeros((len(poses), *camera.frame), dtype=bool)
            for scene in SIDES:
                views = self.data.renderer(scene).render(poses, camera, samples=0)
                labelled = np.isin(views.identity, self.changed)
                mask |= labelled
                if scene == side:
                    heat, depth = labelled.astype(np.float32), self.data.raw_depth(views)
                    grid.add(*projector.project(heat, depth, poses, "rgb", grid))
            cells.append(to_cells(mask.astype(np.float32)) >= POSITIVE_SHARE)
        planes = grid.aggregates()
        return VisibleObjects(np.concatenate(cells), np.nan_to_num(planes[2]), planes[3])

    def _true_domain(self, side: Side, camera: Camera) -> Domain:
        declared = self.store.domains[side]
        return Domain(
            declared.domain, side, camera.lens, camera.lens, camera.height, camera.forward_offset,
            declared.depth_scale, declared.depth_raw_min, declared.depth_raw_max,
        )  # fmt: skip


def move_camera(camera: Camera, move: RenderChange) -> Camera:
    """The world's camera with the offset of an adjustment."""
    return camera.moved(move.height, move.pitch, move.zoom)


def to_cells(heat: NDArray[np.float32]) -> NDArray[np.float32]:
    """Resample maps (n, h, w) to (n, IMAGE_CELLS, IMAGE_CELLS) by area means of finite values.

    A value of a coarser map counts for every cell that its own cell covers.
    """
    height, width = heat.shape[1:]
    rows, cols = (overlap_shares(extent, IMAGE_CELLS) for extent in (height, width))
    known = np.isfinite(heat)
    values = np.where(known, heat, 0).astype(np.float64)
    total, weight = (rows @ plane @ cols.T for plane in (values, known.astype(np.float64)))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(weight > 1e-9, total / weight, np.nan).astype(np.float32)

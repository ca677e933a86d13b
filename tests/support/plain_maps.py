"""Map grids by a plain computation: one heatmap after another, from the definitions."""

import numpy as np

from s2rstore.geometry import camera
from s2rstore.geometry.floor_grid import SAMPLES, Projector, Ray
from s2rstore.geometry.map_grid import CELLS
from s2rstore.geometry.reprojection import NearerSurface
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rstore.run_inputs import run_domain, run_frames


def plain_map_grid(
    store: Store, run: str, kind: str, side: Side, mode: str | None
) -> dict[str, np.ndarray]:
    """Mean, max, sum and count per cell, (rows, cols), over all valid instances of a run."""
    record, bounds, n = store.run(run), store.dataset.bounds, len(store.instances)
    other_side: Side = "real" if side == "sim" else "sim"
    view, other = run_domain(store, record, side), run_domain(store, record, other_side)
    frame = store.dataset.frame_height, store.dataset.frame_width
    depth = run_frames(store, record, side, 0, n, ("depth",))["depth"]
    surface = store.provenance_object(f"run:{run}", "surfaces").get(kind)
    offset = store.rig_offset(record.sim_domain, record.real_domain)
    if surface is not None and offset is not None:
        if side == "real":
            view = offset.applied(view)
        else:
            other = offset.applied(other)
        assert surface == "nearer"
        far = run_frames(store, record, other_side, 0, n, ("depth",))["depth"]
        depth = NearerSurface(view, other, frame)(depth, far)
    truth = store.instances
    poses = np.stack([truth.x, truth.y, truth.heading], axis=1)
    x, y, _, valid = Projector(view, frame, store.dataset.y_down).points(depth, poses)
    heat = store.heatmaps(run, kind, side, 0, n, mode)
    ray: Ray = "depth" if mode == "depth" else "rgb"
    rows, cols, seen = _heat_pixels(view, frame, heat.shape[1:], ray)
    values = heat[:, rows, cols].astype(np.float64)
    size = max(bounds.width, bounds.height) / CELLS
    shape = round(bounds.height / size), round(bounds.width / size)
    row = np.floor((y - bounds.y0) / bounds.height * shape[0])
    col = np.floor((x - bounds.x0) / bounds.width * shape[1])
    inside = (row >= 0) & (row < shape[0]) & (col >= 0) & (col < shape[1])
    predicted = store.run_columns(run).valid[:, None, None]
    used = valid & seen & inside & np.isfinite(values) & predicted
    of_cell: dict[tuple[int, int], list[float]] = {}
    for cell, value in zip(
        zip(row[used].astype(int), col[used].astype(int), strict=True), values[used], strict=True
    ):
        of_cell.setdefault(cell, []).append(value)
    grids = {name: np.full(shape, np.nan) for name in ("mean", "max", "sum")}
    count = np.zeros(shape)
    for cell, found in of_cell.items():
        grids["mean"][cell], grids["max"][cell] = np.mean(found), max(found)
        grids["sum"][cell], count[cell] = sum(found), len(found)
    return {**grids, "count": count}


def _heat_pixels(view, frame, shape, ray: Ray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row and column in a heatmap of each depth sample, and whether it is seen; each (S, S)."""
    v, u = (camera.sample_pixels(SAMPLES, extent) + 0.5 for extent in frame)
    if ray == "depth":
        columns, rows = np.meshgrid(u, v)
        seen = np.ones(rows.shape, dtype=bool)
    else:
        columns, rows, seen = camera.into_rgb(camera.rays(view.depth, v, u), view.rgb, frame)
    heat_rows, heat_columns = (
        np.clip((position / extent * size).astype(int), 0, size - 1)
        for position, extent, size in ((rows, frame[0], shape[0]), (columns, frame[1], shape[1]))
    )
    return heat_rows, heat_columns, seen

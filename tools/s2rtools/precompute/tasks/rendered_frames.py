"""Task: render the frames of a run's sides whose cameras its adjustments move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from s2rstore.geometry.camera_offset import UNCHANGED
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run, Side
from s2rstore.run_inputs import FRAME_KINDS, run_render_change
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.frame_reader import RunFrames
from s2rtools.precompute.unit_computer import UnitComputer
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit
from s2rtools.synthetic_world.stored_world import renderer_version

NAME = "frames"
"""Name of the stages of rendered frames."""
FRAME_ROWS = 32


def frames_stages(
    store: Store, keys: ArrayKeys, run: Run, iids: range, sides: Sequence[Side] = SIDES
) -> list[Stage]:
    """One stage for those of `sides` whose cameras are moved; none if no camera is moved."""
    specs = []
    for side in sides:
        domain, move = store.domain(run.domain(side)), run_render_change(store, run, side)
        if move == UNCHANGED:
            continue
        first = iids.start
        depth = store.frames(domain.domain, first, first + 1, ("depth",))["depth"].dtype.name
        frame = store.dataset.frame_height, store.dataset.frame_width
        key = keys.frames(side, move, renderer_version(store))
        n, axes = len(iids), ("iid", "row", "column")
        specs += [
            ArraySpec(FRAME_KINDS["rgb"], side, None, (*frame, 3), "uint8", (*axes, "channel"), "",
                      key, n, first_iid=first, is_shared=True),
            ArraySpec(FRAME_KINDS["depth"], side, None, frame, depth, axes, "raw", key, n,
                      first_iid=first, is_shared=True),
        ]  # fmt: skip
    if not specs:
        return []
    return [Stage(NAME, run.run, tuple(specs), FRAME_ROWS, compute=render_frames)]


def render_frames(computer: UnitComputer, unit: WorkUnit) -> dict[ArraySpec, NDArray[Any]]:
    """RGB and raw depth of a unit's instances, for each side that is missing."""
    run = computer.store.run(unit.stage.run)
    frames = RunFrames(computer.store, run, renderers=computer.renderers)
    values: dict[ArraySpec, NDArray[Any]] = {}
    for side in SIDES:
        specs = [spec for spec in unit.missing if spec.side == side]
        images = frames.read(side, unit.instances.start, unit.instances.stop) if specs else {}
        by_kind = {FRAME_KINDS[image]: rows for image, rows in images.items()}
        values |= {spec: by_kind[spec.kind] for spec in specs}
    return values

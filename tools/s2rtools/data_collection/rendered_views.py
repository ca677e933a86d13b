"""Views of candidate poses that the user's simulator renders, and the sim errors of a run there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rstore.run_inputs import run_domain
from s2rtools.common.command_line.progress import Reporter
from s2rtools.data_collection.candidates import CandidatePoses, Floats, Poses
from s2rtools.precompute.frame_reader import side_frames
from s2rtools.precompute.pose_predictor import PosePredictor
from s2rtools.renderer.protocol import Ready
from s2rtools.simulated_frames.pose_renderer import FrameCameras, PoseRenderer
from s2rtools.simulated_frames.requested_poses import parameter_values

VIEWS_PER_POSE = 4
"""Candidates that are rendered for each pose of the budget."""
_BLOCK = 16
"""Frames that are read and passed through a network at once."""
_NEAR_WALL = 1 / 3
"""A view whose median depth is below this share of that of all views shows a near wall."""


@dataclass(frozen=True, slots=True)
class CandidateRenderer:
    """A renderer program, as of `s2r render`, and the folder that keeps its frames.

    `assignments` are the parameters that differ from their defaults, `NAME=VALUE` each; `trust`
    allows models that execute code.
    """

    command: Sequence[str]
    frames: Path
    workers: int
    timeout: float
    assignments: Sequence[str] = ()
    trust: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class RenderedViews:
    """What a renderer showed of m candidates: their flat indices `cells` (m,) and poses (m, 3).

    sim_errors (m,) are the errors of the run in metres, NaN where there is no usable view: `failed`
    poses were not rendered, and `near` (m,) views show a near wall. `reason` is that of the first
    failure.
    """

    renderer: Ready
    cells: NDArray[np.intp]
    poses: Poses
    sim_errors: Floats
    near: NDArray[np.bool_]
    failed: NDArray[np.bool_]
    reason: str

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Whether each view (m,) can be used."""
        return ~(self.failed | self.near)


def render_views(
    store: Store, run: Run, settings: CandidateRenderer, candidates: CandidatePoses,
    cells: NDArray[np.intp], reporter: Reporter | None,
) -> RenderedViews:  # fmt: skip
    """Render candidates as the sim side of a run has them, and predict.

    Frames that the folder has are not rendered again. Raises RequestError where the program cannot
    be used, shows nothing or lacks depth that the model takes, and where the run has no model.
    """
    poses = candidates.poses(cells)
    predictor = PosePredictor(store, run, "collect --renderer", settings.trust)
    cameras = FrameCameras.of_domain(store, run_domain(store, run, "sim"))
    with PoseRenderer(
        settings.frames, settings.command, cameras, settings.workers, settings.timeout
    ) as renderer:
        takes_depth = store.models[run.network("collect --renderer")].channels != "rgb"
        if takes_depth and not renderer.ready.depth:
            raise RequestError(
                f"renderer {renderer.ready.name}: renders no depth, which the model of run "
                f"{run.run} takes"
            )
        values = [parameter_values(renderer.ready, settings.assignments)] * len(poses)
        report = () if reporter is None else (reporter.begin, reporter.advance)
        failures = renderer.render(poses, values, *report)
        failed = np.isin(np.arange(len(poses)), list(failures))
        rows = np.flatnonzero(~failed)
        depths = np.full(len(poses), np.inf)

        def inputs() -> Iterator[NDArray[np.float32]]:
            """The inputs of the network block by block; keeps the median depth of each view."""
            for start in range(0, rows.size, _BLOCK):
                some = rows[start : start + _BLOCK]
                images = renderer.images(poses[some], values[: some.size])
                depth = np.where(images["depth"] > 0, images["depth"], np.inf)
                depths[some] = np.median(depth, axis=(1, 2))
                frames = side_frames(
                    images, cameras.domain, run.adjustments("sim"), predictor.contract, store.path
                )
                yield frames.x

        errors = np.full(len(poses), np.nan)
        errors[rows] = predictor.errors(inputs(), poses[rows])
    known = depths[np.isfinite(depths)]
    near = depths < _NEAR_WALL * np.median(known) if known.size else np.zeros_like(failed)
    reason = failures[min(failures)] if failures else ""
    if not (~failed & ~near).any():
        raise RequestError(f"renderer {renderer.ready.name}: rendered no candidate: {reason}")
    return RenderedViews(
        renderer.ready, cells, poses, np.where(near, np.nan, errors), near, failed, reason
    )

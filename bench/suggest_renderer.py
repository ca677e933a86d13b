"""Whether `s2r suggest --renderer` finds the parameters of a room that differs from its defaults.

`python -m bench.suggest_renderer --seeds 10 --log results.jsonl`. Reality is the MuJoCo room with
six of its parameters moved, at poses along walks; the search knows its images, its poses and the
renderer with all parameters at their defaults.
"""

from __future__ import annotations

import argparse
import shlex
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.budget import BudgetRow
from bench.measured_stores import QUIET
from bench.support.json_log import append_log, read_log
from s2rstore.records import Domain, Intrinsics
from s2rtools.simulated_frames.frame_folder import TABLE
from s2rtools.simulated_frames.pose_renderer import FrameCameras, PoseRenderer, renderer_command
from s2rtools.simulated_frames.requested_poses import camera_poses
from s2rtools.suggestions.renderer_search import suggest_parameters
from s2rtools.suggestions.settings import SuggestSettings
from s2rtui.cli import main as s2r

SEEDS = 10
ROOM = Path(__file__).parents[1] / "examples" / "renderers" / "mujoco_room.py"
_COMMAND = shlex.join([sys.executable, str(ROOM)])
_MOVES = {
    "lamp_power": (0.15, 0.5), "texture_contrast": (0.2, 0.5), "zoom": (0.03, 0.12),
    "camera_height": (0.05, 0.25), "camera_pitch": (2.0, 8.0), "distortion": (0.05, 0.2),
}  # fmt: skip
"""How far each parameter is moved, up or down: least and most."""
_DEFAULTS = {"lamp_power": 1.0, "texture_contrast": 1.0, "zoom": 1.0}
_WALKS, _POSES = 4, 40
_FRAME = 240, 320
_LENS = Intrinsics(220.0, 220.0, 160.0, 120.0)
_DOMAIN = Domain("real", "real", _LENS, _LENS, 0.9, 0.0, 0.001, 1, 65534)


@dataclass(frozen=True, slots=True)
class Trial:
    """What was moved in the room of a seed, and the ranges that were found.

    `declared` are the names of parameters and adjustments that count as changed, `lowered` the
    share of the mismatch of held-out images that the values remove.
    """

    seed: int
    truth: dict[str, float]
    values: dict[str, float]
    ranges: dict[str, tuple[float, float]]
    declared: list[str]
    before: float
    after: float
    lowered: float
    frames: int
    seconds: float

    @property
    def missed(self) -> list[str]:
        """Moved parameters that lie outside their range or do not count as changed."""
        return [
            name for name, value in self.truth.items()
            if name not in self.declared
            or not self.ranges[name][0] <= value <= self.ranges[name][1]
        ]  # fmt: skip

    @property
    def false(self) -> list[str]:
        """What counts as changed and was not moved."""
        return [name for name in self.declared if name not in self.truth]


def figures(seeds: int) -> Iterator[BudgetRow]:
    """Rooms with all ranges right, what counts as changed and is not, mismatch left, and time."""
    yield from rows([trial(seed) for seed in range(1, seeds + 1)])


def rows(trials: Sequence[Trial]) -> Iterator[BudgetRow]:
    """The figures of some trials."""
    count = len(trials)
    right = sum(not each.missed for each in trials) / count
    yield BudgetRow(f"suggest: all ranges right, of {count} rooms", right, "share", 0.9, "at least")
    for name in _MOVES:
        found = sum(name not in each.missed for each in trials) / count
        yield BudgetRow(f"suggest: range of {name} right", found, "share", 0.9, "at least")
    yield BudgetRow("suggest: unmoved values declared", sum(len(each.false) for each in trials), "",
                    0.0)  # fmt: skip
    yield BudgetRow("suggest: least share of the mismatch that is removed",
                    min(each.lowered for each in trials), "share", 0.8, "at least")  # fmt: skip
    yield BudgetRow("suggest: longest search", max(each.seconds for each in trials) / 60, "min", 30)
    yield BudgetRow("suggest: frames rendered, median",
                    float(np.median([each.frames for each in trials])), "")  # fmt: skip


def trial(seed: int) -> Trial:
    """Build the room of a seed as a store of real images, and fit the renderer to it."""
    rng = np.random.default_rng(seed)
    truth = {
        name: round(_DEFAULTS.get(name, 0.0) + float(rng.choice([-1, 1]) * rng.uniform(*bounds)), 3)
        for name, bounds in _MOVES.items()
    }
    folder = Path(tempfile.mkdtemp())
    try:
        store = _store(folder, _walks(rng), truth)
        began = time.perf_counter()
        found = suggest_parameters(
            store, renderer_command(_COMMAND), folder / "frames", 2, 120.0,
            SuggestSettings("sim", budget=1800, frames=32, judged=64), QUIET,
        )  # fmt: skip
        seconds = time.perf_counter() - began
    finally:
        shutil.rmtree(folder)
    fitted = (*found.parameters, *found.adjustments)
    return Trial(
        seed, truth, {each.name: each.value for each in fitted},
        found.ranges, [each.name for each in found.changed], round(found.before, 4),
        round(found.after, 4), round(found.lowered.value, 4), found.frames, round(seconds, 1),
    )  # fmt: skip


def _walks(rng: np.random.Generator) -> list[NDArray[np.float64]]:
    """Walks around the rug in the middle of the room: x, y in metres, heading in radians."""
    walks = []
    for _ in range(_WALKS):
        around = rng.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, _POSES)
        reach = rng.uniform(0.6, 1.2) + 0.2 * np.sin(3 * around)
        x, y = 3 + 1.2 * reach * np.cos(around), 2.5 + reach * np.sin(around)
        heading = around + rng.choice([-1, 1]) * np.pi / 2 + rng.normal(0, 0.4, _POSES).cumsum() / 2
        walks.append(np.column_stack([x, y, np.angle(np.exp(1j * heading))]))
    return walks


def _store(folder: Path, walks: Sequence[NDArray[np.float64]], truth: dict[str, float]) -> Path:
    """A store of real images alone, rendered with the true parameters."""
    poses = np.concatenate(walks)
    names = [f"walk-{number}" for number, walk in enumerate(walks) for _ in walk]
    cameras = FrameCameras(_DOMAIN, _FRAME, False)
    command = renderer_command(_COMMAND)
    with PoseRenderer(folder / "real", command, cameras, 2, 120.0) as renderer:
        values = [{each.name: each.default for each in renderer.ready.parameters} | truth]
        if failures := renderer.render(poses, values * len(poses)):
            raise RuntimeError(f"the room cannot be rendered: {failures}")
        keys = renderer.keys(poses, values * len(poses))
        placed = camera_poses(poses, _DOMAIN, False)
        renderer.folder.add_rows(list(zip(keys, names, placed, strict=True)), anew=True)
    path = folder / "room.s2r"
    s2r(["ingest", f"csv:{folder / 'real' / TABLE}", "--side", "real", "--floor", "ground=0",
         "--store", str(path)])  # fmt: skip
    return path


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.suggest_renderer", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="number of rooms (default 10)")
    parser.add_argument("--log", type=Path, help="JSON lines to continue and to append to")
    options = parser.parse_args()
    logged: list[dict[str, Any]] = read_log(options.log) if options.log else []
    trials = [Trial(**each) for each in logged]
    for seed in set(range(1, options.seeds + 1)) - {each.seed for each in trials}:
        trials.append(trial(seed))
        if options.log:
            append_log(options.log, asdict(trials[-1]))
    for each in trials:
        print(f"seed {each.seed}: missed {each.missed}, false {each.false}", flush=True)
    for row in rows(trials):
        print(f"{row.name:<60} {row.value:10.4g} {row.unit}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

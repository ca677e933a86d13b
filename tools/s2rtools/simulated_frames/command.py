"""`s2r render`: render sim frames at requested poses with a renderer program."""

from __future__ import annotations

import argparse
import shutil
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.errors import RequestError, counted
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.progress import reporter

if TYPE_CHECKING:
    from s2rstore.reader import Store
    from s2rstore.records import Domain
    from s2rtools.renderer.frames import RenderedFrame
    from s2rtools.renderer.protocol import Hello, Ready
    from s2rtools.simulated_frames.requested_poses import RequestedPoses

EXAMPLE = "s2r render lab.s2r --renderer 'python my_sim.py' --grid 0.5,8 --out rendered"
BUILT_IN = {"world": "--seed", "mesh": ""}
"""Renderers that ship, by the word before the colon, and the option that takes the word after."""
_TIMEOUT = 120.0
_MOST_WORKERS = 64


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--renderer", required=True, metavar="COMMAND",
                        help="program that speaks the renderer protocol, with its arguments; or "
                        "mesh:FILE.glb, or world:SEED")  # fmt: skip
    parser.add_argument("--domain", help="domain whose camera renders (default: the sim domain)")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="values",
                        help="value of a parameter that the renderer declares "
                        "(repeatable)")  # fmt: skip
    group = parser.add_argument_group("poses (one of these)")
    poses = group.add_mutually_exclusive_group(required=True)
    poses.add_argument("--poses", type=Path, metavar="FILE.csv",
                       help="the poses of a CSV file: x_m, y_m, heading_deg, as `s2r collect` "
                       "writes them")  # fmt: skip
    poses.add_argument("--grid", type=_grid, metavar="METRES,HEADINGS",
                       help="a square grid over the free floor, with evenly spread "
                       "headings")  # fmt: skip
    poses.add_argument("--random", type=int, metavar="N", help="N random poses on the free floor")
    group.add_argument("--seed", type=int, default=0, help="random seed of --random (default 0)")
    group = parser.add_argument_group("output and processes")
    group.add_argument("--out", type=Path, required=True, metavar="DIR",
                       help="folder of the frames, a recording of layout csv; frames that it has "
                       "are not rendered again")  # fmt: skip
    group.add_argument("--workers", type=int, default=1, metavar="K",
                       help="processes of the renderer (default 1)")  # fmt: skip
    group.add_argument("--timeout", type=float, default=_TIMEOUT, metavar="SECONDS",
                       help="time that the renderer has for each answer, its start included "
                       f"(default {_TIMEOUT:g})")  # fmt: skip


def _grid(text: str) -> tuple[float, int]:
    try:
        metres, headings = text.split(",")
        spacing, count = float(metres), int(headings)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: METRES,HEADINGS, such as 0.5,8") from None
    if not (0.05 <= spacing <= 100 and 1 <= count <= 360):
        raise argparse.ArgumentTypeError(f"{text!r}: 0.05 to 100 metres and 1 to 360 headings")
    return spacing, count


def execute(options: argparse.Namespace) -> int:
    if not 1 <= options.workers <= _MOST_WORKERS:
        raise RequestError(f"--workers {options.workers}: must be 1 to {_MOST_WORKERS}")
    if not 0 < options.timeout < 1e6:
        raise RequestError(f"--timeout {options.timeout:g}: must be more than 0 seconds")
    command = renderer_command(options.renderer)
    with s2rstore.open(options.store) as store:
        store.require_poses("render")
        domain = store.domain(options.domain or _sim_domain(store))
        requested = _requested(store, options)
        camera = _camera(store, domain)
    return _render(options, command, domain, camera, requested)


def renderer_command(text: str) -> list[str]:
    """The words of `--renderer`, with a renderer that ships in place of its short name."""
    from s2rtools.renderer.program import parse_command

    kind, colon, argument = text.partition(":")
    if not colon or kind not in BUILT_IN:
        return parse_command(text)
    arguments = [word for word in (BUILT_IN[kind], argument) if word]
    return [sys.executable, "-m", f"s2rtools.renderer.{kind}", *arguments]


def _sim_domain(store: Store) -> str:
    return next(name for name in store.domains if store.domain(name).kind == "sim")


def _requested(store: Store, options: argparse.Namespace) -> RequestedPoses:
    from s2rtools.simulated_frames import requested_poses

    if options.poses is not None:
        return requested_poses.poses_of_file(options.poses)
    if options.grid is not None:
        return requested_poses.poses_on_grid(store, *options.grid)
    most = requested_poses.MOST_FRAMES
    if not 1 <= options.random <= most:
        raise RequestError(f"--random {options.random}: must be 1 to {most:,}")
    if options.seed < 0:
        raise RequestError(f"--seed {options.seed}: must not be negative")
    return requested_poses.random_poses(store, options.random, options.seed)


def _camera(store: Store, domain: Domain) -> Hello:
    from s2rtools.renderer.protocol import Hello

    dataset, lens = store.dataset, domain.rgb
    return Hello(
        width=dataset.frame_width, height=dataset.frame_height, fx=lens.fx, fy=lens.fy,
        cx=lens.cx, cy=lens.cy, y_down=dataset.y_down, folder="",
    )  # fmt: skip


def parameter_values(ready: Ready, assignments: list[str]) -> dict[str, float]:
    """A value for each parameter that a renderer declares, `NAME=VALUE` in place of defaults.

    Raises RequestError for unknown names, for what is no number, and for values out of range.
    """
    declared = {parameter.name: parameter for parameter in ready.parameters}
    values = {name: parameter.default for name, parameter in declared.items()}
    for assignment in assignments:
        name, _, text = assignment.partition("=")
        if name not in declared:
            names = ", ".join(declared) or "none"
            raise RequestError(f"--set {assignment}: the renderer declares {names}")
        parameter = declared[name]
        span = f"{parameter.minimum:g} to {parameter.maximum:g}"
        try:
            value = float(text)
        except ValueError:
            raise RequestError(f"--set {assignment}: must be a number, {span}") from None
        if not parameter.minimum <= value <= parameter.maximum:
            raise RequestError(f"--set {assignment}: must be {span}")
        values[name] = value
    return values


def _render(
    options: argparse.Namespace,
    command: list[str],
    domain: Domain,
    camera: Hello,
    requested: RequestedPoses,
) -> int:
    from s2rtools.renderer.workers import RendererWorkers, RenderJob
    from s2rtools.simulated_frames.frame_folder import FrameFolder
    from s2rtools.simulated_frames.requested_poses import camera_poses

    folder = FrameFolder(options.out, domain, camera)
    poses = camera_poses(requested.poses, domain, camera.y_down)
    files = options.out / "renderer"
    failures: list[str] = []
    with (
        RendererWorkers(command, camera, files, options.workers, options.timeout) as workers,
        reporter() as progress,
    ):
        ready = workers.ready
        values = parameter_values(ready, options.values)
        keys = [folder.key(ready, pose, values) for pose in poses]
        jobs = [
            RenderJob(number, pose, values)
            for number, (key, pose) in enumerate(zip(keys, poses, strict=True))
            if not folder.has(key)
        ]
        progress.begin("render", len(jobs))

        def save(number: int, frame: RenderedFrame) -> None:
            folder.save(keys[number], frame)

        try:
            with closing(workers.render(jobs, save)) as results:
                for result in results:
                    progress.advance(1)
                    if result.failure:
                        failures.append(f"pose {result.number + 1}: {result.failure}")
        finally:
            rows = folder.add_rows(keys, poses, requested.name, ready.depth)
    for worker in range(options.workers):
        shutil.rmtree(files / f"worker-{worker}", ignore_errors=True)
    rendered = len(jobs) - len(failures)
    print(printable(
        f"{options.out}: {counted(rendered, 'frame')} rendered by {ready.name} {ready.version}, "
        f"{len(poses) - len(jobs)} there before; {rows} in {options.out / 'frames.csv'}"
    ))  # fmt: skip
    if failures:
        count = counted(len(failures), "frame")
        print(printable(f"{count} failed; the first: {failures[0]}"), file=sys.stderr)
    return 1 if failures else 0

"""`s2r render`: render sim frames at requested poses with a renderer program."""

from __future__ import annotations

import argparse
import shlex
import shutil
import sys
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import s2rstore
from s2rstore.errors import RequestError, counted
from s2rstore.files.layout import checked_name
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.progress import reporter

if TYPE_CHECKING:
    from s2rstore.reader import Store
    from s2rstore.records import Domain, Intrinsics
    from s2rtools.renderer.frames import RenderedFrame
    from s2rtools.renderer.protocol import Hello, Ready
    from s2rtools.simulated_frames.frame_folder import FrameFolder
    from s2rtools.simulated_frames.requested_poses import RequestedPoses

EXAMPLE = "s2r render lab.s2r --renderer 'python my_sim.py' --grid 0.5,8"
BUILT_IN = {"world": "--seed", "mesh": ""}
"""Renderers that ship, by the word before the colon, and the option that takes the word after."""
SIDE: Literal["sim"] = "sim"
"""Side and domain of rendered frames in a store."""
_TIMEOUT = 120.0
_MOST_WORKERS = 64


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--renderer", required=True, metavar="COMMAND",
                        help="program that speaks the renderer protocol, with its arguments; or "
                        "mesh:FILE.glb, or world:SEED")  # fmt: skip
    parser.add_argument("--domain", help="domain whose camera renders (default: the sim domain; in "
                        "a store without one, the first)")  # fmt: skip
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="values",
                        help="value of a parameter that the renderer declares "
                        "(repeatable)")  # fmt: skip
    group = parser.add_argument_group("poses (one of these)")
    poses = group.add_mutually_exclusive_group(required=True)
    poses.add_argument("--missing", action="store_true",
                       help="the instances of trajectories without sim images")  # fmt: skip
    poses.add_argument("--poses", type=Path, metavar="FILE.csv",
                       help="the poses of a CSV file: x_m, y_m, heading_deg, as `s2r collect` "
                       "writes them")  # fmt: skip
    poses.add_argument("--grid", type=_grid, metavar="METRES,HEADINGS",
                       help="a square grid over the free floor, with evenly spread "
                       "headings")  # fmt: skip
    poses.add_argument("--random", type=int, metavar="N", help="N random poses on the free floor")
    group.add_argument("--seed", type=int, default=0, help="random seed of --random (default 0)")
    group.add_argument("--trajectory", metavar="NAME",
                       help="trajectory that the poses become (default: grid, random-SEED or the "
                       "name of the file)")  # fmt: skip
    group = parser.add_argument_group("output and processes")
    group.add_argument("--out", type=Path, metavar="DIR",
                       help="folder of the frames, a recording of layout csv (default: "
                       "STORE-frames); frames that it has are not rendered again")  # fmt: skip
    group.add_argument("--frames-only", action="store_true",
                       help="write the folder and leave the store as it is")  # fmt: skip
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
        domain = store.domain(options.domain or _default_domain(store))
        if not options.frames_only:
            _check_domain(store, domain.domain)
        requested = _requested(store, options)
        if options.trajectory is not None:
            if requested.are_stored:
                raise RequestError("--trajectory: --missing keeps the trajectories of the store")
            requested = requested.renamed(checked_name(options.trajectory, "--trajectory"))
        frame = store.dataset.frame_height, store.dataset.frame_width
        y_down = store.dataset.y_down
    path = options.out or options.store.with_name(f"{options.store.stem}-frames")
    if options.store.resolve() in path.resolve().parents:
        raise RequestError(f"--out {path}: lies inside the store")
    code = _render(options, path, command, FrameCameras(domain, frame, y_down), requested)
    if options.frames_only:
        return code
    if code and requested.are_stored:
        line = f"{options.store}: unchanged; images are added when all instances have one"
        print(printable(line), file=sys.stderr)
        return code
    from s2rtools.simulated_frames.append_frames import append_frames

    return append_frames(path, options.store, domain) or code


def renderer_command(text: str) -> list[str]:
    """The words of `--renderer`, as a shell splits them; no shell is used.

    A renderer that ships takes the place of its short name. Raises RequestError for unbalanced
    quotes and for a program that does not exist.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise RequestError(f"--renderer {text}: {error}") from error
    if not words:
        raise RequestError("--renderer: names no program")
    kind, colon, argument = words[0].partition(":")
    if colon and kind in BUILT_IN:
        option = [BUILT_IN[kind]] if BUILT_IN[kind] else []
        program = [sys.executable, "-P", "-m", f"s2rtools.renderer.{kind}"]
        return [*program, *option, argument, *words[1:]]
    if shutil.which(words[0]) is None:
        raise RequestError(f"--renderer {text}: there is no program {words[0]!r}")
    return words


def _default_domain(store: Store) -> str:
    """The sim domain; in a store without one, the first."""
    kinds = {name: store.domain(name).kind for name in store.domains}
    return next((name for name, kind in kinds.items() if kind == "sim"), next(iter(kinds)))


def _check_domain(store: Store, name: str) -> None:
    """Raise RequestError where frames of a domain's cameras cannot be added to the store."""
    if SIDE in store.domains and name != SIDE:
        raise RequestError(
            f"--domain {name}: frames are added to domain {SIDE}; --frames-only leaves the store "
            "as it is"
        )


def _requested(store: Store, options: argparse.Namespace) -> RequestedPoses:
    from s2rtools.simulated_frames import requested_poses

    if options.missing:
        return requested_poses.missing_poses(store, SIDE)
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


def parameter_values(ready: Ready, assignments: list[str]) -> dict[str, float]:
    """A value for each parameter that a renderer declares, `NAME=VALUE` in place of defaults.

    Raises RequestError for unknown names, for what is no number, and for values out of range.
    """
    declared = {parameter.name: parameter for parameter in ready.parameters}
    values = {name: parameter.default for name, parameter in declared.items()}
    for assignment in assignments:
        name, sign, text = assignment.partition("=")
        if not sign:
            raise RequestError(f"--set {assignment}: expected NAME=VALUE")
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


@dataclass(frozen=True, slots=True)
class FrameCameras:
    """The cameras of a domain, for frames of (height, width) pixels."""

    domain: Domain
    frame: tuple[int, int]
    y_down: bool

    @property
    def lenses(self) -> list[tuple[Intrinsics, tuple[str, ...]]]:
        """Each camera with the images that it takes: one for both, or one for each."""
        domain = self.domain
        if not domain.has_depth or domain.depth == domain.rgb:
            return [(domain.rgb, ("rgb", "depth"))]
        return [(domain.rgb, ("rgb",)), (domain.depth, ("depth",))]

    def hello(self, lens: Intrinsics) -> Hello:
        """What a renderer is told about a camera."""
        from s2rtools.renderer.protocol import Hello

        return Hello(
            width=self.frame[1], height=self.frame[0], fx=lens.fx, fy=lens.fy, cx=lens.cx,
            cy=lens.cy, y_down=self.y_down, folder="",
        )  # fmt: skip


def _save(
    folder: FrameFolder, keys: list[str], images: tuple[str, ...], number: int, frame: RenderedFrame
) -> None:
    folder.save(keys[number], frame, images)


def _render(
    options: argparse.Namespace,
    path: Path,
    command: list[str],
    cameras: FrameCameras,
    requested: RequestedPoses,
) -> int:
    """Render the frames that a folder lacks; 1 where some could not be rendered.

    Where RGB and depth have different cameras, each pose is rendered by both.
    """
    from s2rtools.renderer.workers import RendererWorkers, RenderJob
    from s2rtools.simulated_frames.frame_folder import TABLE, FrameFolder, prepare_folder
    from s2rtools.simulated_frames.requested_poses import camera_poses

    prepare_folder(path)
    domain, files = cameras.domain, path / "renderer"
    rgb_poses = camera_poses(requested.poses, domain, cameras.y_down)
    failures: dict[int, str] = {}
    before, keys = 0, list[str]()
    for lens, images in cameras.lenses:
        with (
            RendererWorkers(
                command, cameras.hello(lens), files, options.workers, options.timeout
            ) as workers,
            reporter() as progress,
        ):
            ready = workers.ready
            values = parameter_values(ready, options.values)
            if domain.has_depth and not ready.depth and not options.frames_only:
                raise RequestError(
                    f"renderer {ready.name}: renders no depth, domain {domain.domain} has depth; "
                    "--frames-only leaves the store as it is"
                )
            folder = FrameFolder(path, domain, cameras.frame, domain.has_depth and ready.depth)
            if not keys:
                keys = [folder.key(ready, pose, values) for pose in rgb_poses]
                before = sum(folder.has(key) for key in keys)
            wanted = [each for each in images if each == "rgb" or folder.has_depth]
            poses = camera_poses(requested.poses, replace(domain, rgb=lens), cameras.y_down)
            jobs = [
                RenderJob(number, pose, values)
                for number, (key, pose) in enumerate(zip(keys, poses, strict=True))
                if wanted and number not in failures and not folder.has(key, *wanted)
            ]
            progress.begin(f"render {' and '.join(wanted)}", len(jobs))

            save = partial(_save, folder, keys, images)
            try:
                with closing(workers.render(jobs, save)) as results:
                    for result in results:
                        progress.advance(1)
                        if result.failure:
                            failures[result.number] = result.failure
            finally:
                frames = list(zip(keys, requested.names, rgb_poses, strict=True))
                folder.add_rows(frames, anew=requested.are_stored)
    for worker in range(options.workers):
        shutil.rmtree(files / f"worker-{worker}", ignore_errors=True)
    rendered = len(keys) - before - len(failures)
    print(printable(
        f"{path / TABLE}: {counted(rendered, 'frame')} rendered by {ready.name} {ready.version}, "
        f"{before} there before"
    ))  # fmt: skip
    if failures:
        number, reason = min(failures.items())
        count = counted(len(failures), "frame")
        print(printable(f"{count} failed; the first: pose {number + 1}: {reason}"), file=sys.stderr)
    return 1 if failures else 0

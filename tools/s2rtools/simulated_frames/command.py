"""`s2r render`: render sim frames at requested poses with a renderer program."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
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
    from s2rtools.simulated_frames.pose_renderer import PoseRenderer
    from s2rtools.simulated_frames.requested_poses import RequestedPoses

EXAMPLE = "s2r render lab.s2r --renderer 'python my_sim.py' --grid 0.5,8"
SIDE: Literal["sim"] = "sim"
"""Side and domain of rendered frames in a store."""
_OPTIONS = {"values": "set"}
"""Options whose name in the parsed options is another."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--renderer", required=True, metavar="COMMAND",
                        help="program that speaks the renderer protocol, with its arguments; or "
                        "mesh:FILE.glb, or world:SEED")  # fmt: skip
    parser.add_argument("--domain", help="domain whose camera renders (default: the sim domain; in "
                        "a store without one, the first)")  # fmt: skip
    add_values(parser)
    group = parser.add_argument_group("poses (one of these)")
    poses = group.add_mutually_exclusive_group(required=True)
    poses.add_argument("--missing", action="store_true",
                       help="the instances of trajectories that lack sim images")  # fmt: skip
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
    add_processes(group)


def add_values(parser: argparse._ActionsContainer) -> None:
    """Add the option that sets parameters of the renderer."""
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", dest="values",
                        help="value of a parameter that the renderer declares "
                        "(repeatable)")  # fmt: skip


def add_processes(group: argparse._ArgumentGroup) -> None:
    """Add the options of the renderer's processes."""
    group.add_argument("--workers", type=int, default=1, metavar="K",
                       help="processes of the renderer (default 1)")  # fmt: skip
    group.add_argument("--timeout", type=float, default=120.0, metavar="SECONDS",
                       help="time that the renderer has for each answer, its start included "
                       "(default 120)")  # fmt: skip


def refuse(options: argparse.Namespace, names: Sequence[str], reason: str) -> None:
    """Raise RequestError for the first of some options that is not at its default."""
    for name in names:
        if getattr(options, name) != options.parser.get_default(name):
            raise RequestError(f"--{_OPTIONS.get(name, name).replace('_', '-')}: {reason}")


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
    from s2rtools.simulated_frames import pose_renderer

    pose_renderer.check_processes(options.workers, options.timeout)
    command = pose_renderer.renderer_command(options.renderer)
    with s2rstore.open(options.store) as store:
        store.require_poses("render")
        cameras = pose_renderer.FrameCameras.of_store(store, options.domain)
        if not options.frames_only:
            _check_domain(store, cameras.domain.domain)
        requested = _requested(store, options)
        if options.trajectory is not None:
            if requested.are_stored:
                raise RequestError("--trajectory: --missing keeps the trajectories of the store")
            requested = requested.renamed(checked_name(options.trajectory, "--trajectory"))
    path = pose_renderer.frames_path(options.store, options.out)
    with pose_renderer.PoseRenderer(
        path, command, cameras, options.workers, options.timeout
    ) as renderer:
        code = _render(options, renderer, requested)
    if options.frames_only:
        return code
    if code and requested.are_stored:
        line = f"{options.store}: unchanged; images are added when all instances have one"
        print(printable(line), file=sys.stderr)
        return code
    from s2rtools.simulated_frames.append_frames import append_frames

    return append_frames(path, options.store, cameras.domain) or code


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


def _render(options: argparse.Namespace, renderer: PoseRenderer, requested: RequestedPoses) -> int:
    """Render the frames that the folder lacks; 1 where some could not be rendered."""
    from s2rtools.simulated_frames.frame_folder import TABLE
    from s2rtools.simulated_frames.requested_poses import camera_poses, parameter_values

    ready, folder, cameras = renderer.ready, renderer.folder, renderer.cameras
    values = [parameter_values(ready, options.values)] * len(requested.poses)
    if cameras.domain.has_depth and not ready.depth and not options.frames_only:
        raise RequestError(
            f"renderer {ready.name}: renders no depth, domain {cameras.domain.domain} has depth; "
            "--frames-only leaves the store as it is"
        )
    keys = renderer.keys(requested.poses, values)
    before = sum(folder.has(key) for key in keys)
    try:
        with reporter() as progress:
            failures = renderer.render(requested.poses, values, progress.begin, progress.advance)
    finally:
        placed = camera_poses(requested.poses, cameras.domain, cameras.y_down)
        folder.add_rows(
            list(zip(keys, requested.names, placed, strict=True)), anew=requested.are_stored
        )
    rendered = len(keys) - before - len(failures)
    print(printable(
        f"{folder.path / TABLE}: {counted(rendered, 'frame')} rendered by {ready.name} "
        f"{ready.version}, {before} there before"
    ))  # fmt: skip
    if failures:
        number, reason = min(failures.items())
        count = counted(len(failures), "frame")
        print(printable(f"{count} failed; the first: pose {number + 1}: {reason}"), file=sys.stderr)
    return 1 if failures else 0

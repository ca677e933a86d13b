"""`s2r collect`: choose the poses at which new real images lower the real error the most."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files.planned_poses import COLUMNS, as_rows
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.command_line.output import print_coverage
from s2rtools.common.command_line.progress import reporter
from s2rtools.simulated_frames.command import add_processes, add_values, refuse

if TYPE_CHECKING:
    from s2rstore.reader import Store
    from s2rtools.data_collection.plan import CollectionPlan
    from s2rtools.data_collection.rendered_views import CandidateRenderer, RenderedViews

METHODS = ("combined", "error", "novelty", "uniform", "random")
"""As `s2rtools.data_collection.METHODS`, without importing the tools for `--help`."""
EXAMPLE = "s2r collect lab.s2r --run vanilla --budget 60 --out poses.csv --save collect"
_SHOWN = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--run", help="run whose errors count (default: the first)")
    parser.add_argument("--budget", type=int, default=60, metavar="N",
                        help="number of new real images (default 60)")  # fmt: skip
    parser.add_argument("--method", choices=METHODS, default="combined",
                        help="what counts: the real error that the sim error does not explain, "
                        "and novelty (combined); the real error; novelty; nothing, spread evenly "
                        "(uniform) or at random (default combined)")  # fmt: skip
    parser.add_argument("--seed", type=int, default=0,
                        help="random seed of --method random (default 0)")  # fmt: skip
    group = parser.add_argument_group("your own simulator")
    group.add_argument("--renderer", metavar="COMMAND",
                       help="program that speaks the renderer protocol, as of `s2r render`: render "
                       "the best candidates, and choose among their views by the errors of the "
                       "run's model there")  # fmt: skip
    add_values(group)
    add_processes(group)
    group.add_argument("--frames", type=Path, metavar="DIR",
                       help="folder of the rendered frames (default: STORE-frames); frames that it "
                       "has are not rendered again")  # fmt: skip
    group.add_argument("--trust", action="store_true",
                       help="allow model formats that execute code")  # fmt: skip
    group = parser.add_argument_group("output")
    group.add_argument("--out", type=Path, metavar="FILE.csv", help="write the poses to this file")
    group.add_argument("--save", metavar="NAME",
                        help="save the instances nearest to the poses as selection "
                        "@NAME")  # fmt: skip
    group.add_argument("--json", action="store_true", help="print JSON")
    output.add_safe_csv(group)


def execute(options: argparse.Namespace, save: Callable[[Store, CollectionPlan, str], None]) -> int:
    """Run the command; `save` saves the selection of `--save`, whose name is checked already."""
    from s2rtools.data_collection.plan import CollectionRequest, plan_collection

    request = CollectionRequest("", options.budget, options.method, options.seed)
    renderer = _renderer(options)
    folder = None if options.out is None else options.out.resolve().parent
    if folder is not None and not folder.is_dir():
        raise RequestError(f"--out {options.out}: there is no folder {folder}")
    with s2rstore.open(options.store) as store, reporter() as progress:
        store.require_poses("collect")
        request = replace(request, run=store.run_name(options.run))
        print_coverage(store, [request.run])
        plan = plan_collection(store, request, progress, renderer)
        if options.out is not None:
            _write(plan, options)
        if options.save is not None:
            save(store, plan, options.save)
    if options.json:
        json.dump(_content(plan), sys.stdout, indent=1, allow_nan=False)
        sys.stdout.write("\n")
        return 0
    print("\n".join(_lines(plan, options)))
    return 0


def _renderer(options: argparse.Namespace) -> CandidateRenderer | None:
    if options.renderer is None:
        refuse(options, ("values", "workers", "timeout", "frames", "trust"), "only with --renderer")
        return None
    from s2rtools.data_collection.rendered_views import CandidateRenderer
    from s2rtools.simulated_frames import pose_renderer

    pose_renderer.check_processes(options.workers, options.timeout)
    command = pose_renderer.renderer_command(options.renderer)
    frames = pose_renderer.frames_path(options.store, options.frames)
    return CandidateRenderer(
        command, frames, options.workers, options.timeout, options.values, options.trust
    )


def _write(plan: CollectionPlan, options: argparse.Namespace) -> None:
    from s2rtools.common.command_line.row_formats import csv_text

    text = csv_text(COLUMNS, as_rows(plan.poses), safe=options.safe_csv)
    output.write_file(options.out, text.encode(errors="backslashreplace"))


def _content(plan: CollectionPlan) -> dict[str, Any]:
    request = plan.request
    return {
        "run": request.run,
        "method": request.method,
        "budget": request.budget,
        "seed": request.seed,
        "candidates": plan.candidates,
        "places": plan.places,
        "origin": plan.origin,
        "evidence": plan.evidence,
        "training_images": plan.training_images,
        "uses_harm": plan.uses_harm,
        "reducible_m": round(plan.reducible, 6),
        "covered_share": round(plan.covered, 6),
        "rendered": None if plan.views is None else _views(plan.views),
        "covered_share_before": round(plan.covered_before, 6),
        "expression": plan.expression,
        "poses": [dict(zip(COLUMNS, row, strict=True)) for row in as_rows(plan.poses)],
    }


def _views(views: RenderedViews) -> dict[str, int]:
    """Numbers of the rendered candidates."""
    return {
        "usable": int(views.usable.sum()), "near_wall": int(views.near.sum()),
        "failed": int(views.failed.sum()),
    }  # fmt: skip


def _views_text(views: RenderedViews) -> str:
    """How many candidates were rendered, and why some are not used, in one line."""
    numbers = _views(views)
    first = f"; the first: {views.reason}" if views.reason else ""
    return printable(
        f"{views.renderer.name} {views.renderer.version}: {numbers['usable']} usable views of "
        f"{len(views.cells)} candidates; {numbers['near_wall']} show a near wall, "
        f"{numbers['failed']} failed{first}"
    )


def _lines(plan: CollectionPlan, options: argparse.Namespace) -> list[str]:
    request = plan.request
    method = f"random, seed {request.seed}" if request.method == "random" else request.method
    known = f"{plan.evidence} new instances"
    if plan.training_images:
        known += f" and {plan.training_images} real training images"
    lines = [
        f"run {request.run}: {len(plan.poses)} poses ({method}) of {plan.candidates:,} candidates, "
        f"{plan.origin}; from {known}{' with harm' if plan.uses_harm else ''}",
        f"reducible error: {plan.reducible:.2f} m in the mean over the candidates; the poses cover "
        f"{plan.covered:.0%} of it"
        + (f", training images {plan.covered_before:.0%}" if plan.covered_before else ""),
        "rooms: " + ", ".join(f"{name} {count}" for name, count in plan.counts_by_room()),
    ]
    if plan.views is not None:
        lines.append(_views_text(plan.views))
    if len(plan.poses) < request.budget:
        lines.append(f"there are only {len(plan.poses)} candidates for --budget {request.budget}")
    shown = plan.poses if options.out is None else plan.poses[:_SHOWN]
    lines += ["", output.table(COLUMNS, as_rows(shown)).rstrip()]
    if len(shown) < len(plan.poses):
        lines.append(f"... and {len(plan.poses) - len(shown)} more in {options.out}")
    lines += ["", f"nearest instances: {plan.expression}"]
    if options.save is not None:
        lines.append(f"saved as @{options.save}")
    if options.out is not None:
        lines.append(f"map: s2r export {options.store} --view map --run {request.run} "
                     f"--poses {options.out} --out map.png")  # fmt: skip
    return lines

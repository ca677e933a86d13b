"""`s2r collect`: choose poses for new real images, to train a model on or to evaluate it."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import s2rstore
from s2rstore.files.planned_poses import COLUMNS, SAMPLE_COLUMNS, STRATUM_COLUMNS, as_rows
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.command_line.output import print_coverage
from s2rtools.common.command_line.progress import add_progress, reporter
from s2rtools.common.result_files import check_writable
from s2rtools.simulated_frames.command import add_processes, add_values, refuse

if TYPE_CHECKING:
    from s2rstore.reader import Store
    from s2rtools.data_collection.plan import CollectionPlan
    from s2rtools.data_collection.rendered_views import CandidateRenderer, RenderedViews

METHODS = ("combined", "error", "novelty", "uniform", "random")
"""As `s2rtools.data_collection.METHODS`, without importing the tools for `--help`."""
EXAMPLE = """s2r collect lab.s2r --run vanilla --budget 60 --out poses.csv --save collect
  s2r collect lab.s2r --run vanilla --renderer 'python my_sim.py' --out poses.csv
  s2r collect lab.s2r --for evaluation --out sample.csv"""
PURPOSES = ("training", "evaluation")
_BUDGET, _SAMPLE_BUDGET = 60, 100
_SHOWN = 10
Rows = Sequence[tuple[float | str | None, ...]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--run", help="run whose errors count (default: the first)")
    parser.add_argument("--for", dest="purpose", choices=PURPOSES, default="training",
                        help="training: the images from which the run gains most; evaluation: a "
                        "stratified sample of the candidates, whose mean error `s2r evaluate "
                        "--sample` gives (default training)")  # fmt: skip
    parser.add_argument("--budget", type=int, metavar="N",
                        help="number of new real images (default 60, for evaluation "
                        "100)")  # fmt: skip
    parser.add_argument("--method", choices=METHODS,
                        help="what counts: the real error that the sim error does not explain, "
                        "and novelty (combined); the real error; novelty; nothing, spread evenly "
                        "(uniform) or at random (default combined)")  # fmt: skip
    parser.add_argument("--seed", type=int, default=0,
                        help="random seed of --method random and of the sample (default "
                        "0)")  # fmt: skip
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
    add_progress(group)
    output.add_safe_csv(group)


def execute(options: argparse.Namespace, save: Callable[[Store, CollectionPlan, str], None]) -> int:
    """Run the command; `save` saves the selection of `--save`, whose name is checked already."""
    check_writable({"--out": options.out}, devices=True)
    if options.purpose == "evaluation":
        return _execute_sample(options)
    from s2rtools.data_collection.plan import CollectionRequest, plan_collection

    budget = _BUDGET if options.budget is None else options.budget
    request = CollectionRequest("", budget, options.method or "combined", options.seed)
    renderer = _renderer(options)
    with s2rstore.open(options.store) as store, reporter(options.progress) as progress:
        store.require_poses("collect")
        request = replace(request, run=store.run_name(options.run))
        print_coverage(store, [request.run])
        plan = plan_collection(store, request, progress, renderer)
        if options.out is not None:
            _write(COLUMNS, as_rows(plan.poses), options)
        if options.save is not None:
            save(store, plan, options.save)
    _print(_content(plan), _lines(plan, options), options)
    return 0


def _execute_sample(options: argparse.Namespace) -> int:
    """Choose a stratified sample of the candidates."""
    from s2rtools.data_collection.evaluation_sample import sample_store

    refuse(options, ("run", "method", "renderer", "save"), "not with --for evaluation")
    _renderer(options)
    budget = _SAMPLE_BUDGET if options.budget is None else options.budget
    with s2rstore.open(options.store) as store, reporter(options.progress) as progress:
        store.require_poses("collect")
        chosen = sample_store(store, budget, options.seed, progress)
    sample = chosen.sample
    if options.out is not None:
        _write(SAMPLE_COLUMNS, sample.file_rows, options)
    content = {
        "budget": budget, "seed": chosen.seed, "candidates": chosen.candidates,
        "places": chosen.places, "origin": sample.candidates, "instances": sample.instances,
        "poses": _objects(STRATUM_COLUMNS, sample.rows),
    }  # fmt: skip
    lines = [
        f"a sample of {budget} of {chosen.candidates:,} candidates, {sample.candidates}, seed "
        f"{chosen.seed}: the plain mean over images at all of its poses is unbiased",
        *_table(STRATUM_COLUMNS, sample.rows, options),
    ]
    if options.out is not None:
        lines += ["", f"then: s2r evaluate {options.store} --run RUN --sample {options.out}"]
    _print(content, lines, options)
    return 0


def _print(content: dict[str, Any], lines: list[str], options: argparse.Namespace) -> None:
    if options.json:
        json.dump(content, sys.stdout, indent=1, allow_nan=False)
        sys.stdout.write("\n")
    else:
        print("\n".join(lines))


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


def _write(columns: Sequence[str], rows: Rows, options: argparse.Namespace) -> None:
    from s2rtools.common.command_line.row_formats import csv_text

    text = csv_text(columns, rows, safe=options.safe_csv)
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
        "reducible_m": plan.reducible.as_json(),
        "covered_share": round(plan.covered, 6),
        "rendered": None if plan.views is None else _views(plan.views),
        "covered_share_before": round(plan.covered_before, 6),
        "expression": plan.expression,
        "poses": _objects(COLUMNS, as_rows(plan.poses)),
    }


def _objects(columns: Sequence[str], rows: Rows) -> list[dict[str, Any]]:
    return [dict(zip(columns, row, strict=True)) for row in rows]


def _table(columns: Sequence[str], rows: Rows, options: argparse.Namespace) -> list[str]:
    """The poses as a table; of those in a file, the first ones."""
    shown = rows if options.out is None else rows[:_SHOWN]
    more = len(rows) - len(shown)
    rest = [f"... and {more} more in {options.out}"] if more else []
    return ["", output.table(columns, shown).rstrip(), *rest]


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
    covered = "it" if request.weighting == "combined" else f"what --method {method} weighs"
    lines = [
        f"run {request.run}: {len(plan.poses)} poses ({method}) of {plan.candidates:,} candidates, "
        f"{plan.origin}; from {known}{' with harm' if plan.uses_harm else ''}",
        f"reducible error: {plan.reducible.with_bounds('{:.2f} m'.format)} in the mean over the "
        f"candidates; the poses cover {100 * plan.covered:.0f} % of {covered}"
        + (f", training images {100 * plan.covered_before:.0f} %" if plan.covered_before else ""),
        "rooms: " + ", ".join(f"{name} {count}" for name, count in plan.counts_by_room()),
    ]
    if plan.views is not None:
        lines.append(_views_text(plan.views))
    if len(plan.poses) < request.budget:
        lines.append(f"there are only {len(plan.poses)} candidates for --budget {request.budget}")
    rows = as_rows(plan.poses)
    lines += [*_table(COLUMNS, rows, options), "", f"nearest instances: {plan.expression}"]
    if options.save is not None:
        lines.append(f"saved as @{options.save}")
    if options.out is not None:
        lines.append(f"map: s2r export {options.store} --view map --run {request.run} "
                     f"--poses {options.out} --out map.png")  # fmt: skip
    return lines

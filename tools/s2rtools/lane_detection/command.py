"""`s2r thresholds`: render roads, tune a line detector, compare translation with calibration."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError
from s2rtools.common.command_line.progress import reporter

if TYPE_CHECKING:
    from s2rtools.lane_detection.conditions import Condition
EXAMPLE = "s2r thresholds report --sim rendered/ --real duckietown/ --out results/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(metavar="ACTION", title="actions", required=True)
    _add_render(actions.add_parser("render", help="render road images with exact line masks"))
    _add_tune(actions.add_parser("tune", help="tune HSV ranges on labelled images"))
    _add_report(
        actions.add_parser(
            "report", help="compare translation with calibration on labelled real images"
        )
    )


def _add_render(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, help="new folder for the images")
    parser.add_argument("--frames", type=int, default=200, metavar="N",
                        help="images per condition (default %(default)s)")  # fmt: skip
    parser.add_argument("--condition", default="day", metavar="NAME,...",
                        help="lights and cameras, or `all` (default day)")  # fmt: skip
    parser.add_argument("--no-lines", action="store_true", help="render roads without lines")
    parser.add_argument("--seed", type=int, default=1, help="random seed (default 1)")
    parser.set_defaults(action=_render)


def _add_tune(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="folder with images/, masks/ and index.csv")
    parser.add_argument("--condition", metavar="NAME", help="use only images of this condition")
    parser.add_argument("--images", type=int, metavar="K",
                        help="use K labelled images, drawn by seed (default: all)")  # fmt: skip
    parser.add_argument("--anti-instagram", action="store_true",
                        help="tune for images after the anti-instagram map")  # fmt: skip
    _add_crop(parser)
    parser.add_argument("--seed", type=int, default=1, help="random seed (default 1)")
    parser.add_argument("--json", action="store_true", help="print the ranges as JSON")
    parser.set_defaults(action=_tune)


def _add_report(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--sim", type=Path, required=True, metavar="DIR", help="labelled simulated images")
    add("--real", type=Path, required=True, metavar="DIR",
        help="real images, some of them labelled")  # fmt: skip
    add("--translators", metavar="NAME,...",
        help="methods (NAME or NAME:OPTION=VALUE) and translator files, or `all` methods "
        "(default: the methods that need no training)")  # fmt: skip
    add("--scopes", metavar="SCOPE,...",
        help="real images on which translators are fitted: of the judged `light`, of `all` lights, "
        "of all `others` (default: each of the three)")  # fmt: skip
    add("--seeds", type=int, default=3,
        help="fits per learned method, and draws of labelled images (default 3)")  # fmt: skip
    add("--minutes", type=float, metavar="M", help="time per fit of a learned method")
    add("--out", type=Path, metavar="DIR",
        help="folder for report.json, arms.csv, figure.png, summary.txt and fitted translators; "
        "a later call continues with the translators found there")  # fmt: skip
    _add_crop(parser)
    add("--json", action="store_true", help="print the results as JSON")
    parser.set_defaults(action=_report)


def _add_crop(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--crop", choices=("auto", "none", "top"), default="auto",
                        help="cut the upper third off, or not; auto decides by the aspect ratio "
                        "(default auto)")  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    status: int = options.action(options)
    return status


def _render(options: argparse.Namespace) -> int:
    from s2rtools.lane_detection.rendered_folder import write_rendered

    if options.seed < 0:
        raise RequestError(f"--seed {options.seed}: must not be negative")
    conditions = _conditions(options.condition)
    with reporter() as progress:
        progress.begin("images", max(0, options.frames) * len(conditions))
        count = write_rendered(
            options.out, conditions, options.frames, options.seed, not options.no_lines,
            progress.advance,
        )  # fmt: skip
    print(f"{options.out}: {count} images written; next: `s2r thresholds tune {options.out}`")
    return 0


def _conditions(text: str) -> list[Condition]:
    from s2rtools.lane_detection.conditions import CONDITIONS, find_condition

    if text == "all":
        return list(CONDITIONS.values())
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names or len(set(names)) < len(names):
        raise RequestError(f"--condition {text!r}: name each condition once, such as day,dark")
    return [find_condition(name) for name in names]


def _tune(options: argparse.Namespace) -> int:
    import numpy as np

    from s2rtools.lane_detection.line_detector import anti_instagram
    from s2rtools.lane_detection.road_images import read_road_images
    from s2rtools.lane_detection.threshold_tuning import tune
    from s2rtools.lane_detection.thresholds_text import tuning_document, tuning_yaml

    images = read_road_images(options.folder, options.crop)
    rows = np.flatnonzero(images.labelled)
    if options.condition is not None:
        rows = rows[images.conditions[rows] == options.condition]
        if not len(rows):
            known = ", ".join(sorted(set(images.conditions.tolist())))
            raise RequestError(
                f"--condition {options.condition!r}: no labelled images; conditions: {known}"
            )
    if options.images is not None:
        if not 1 <= options.images <= len(rows):
            raise RequestError(f"--images {options.images}: must be 1 to {len(rows)}")
        rng = np.random.default_rng(options.seed)
        rows = np.sort(rng.choice(rows, options.images, replace=False))
    chosen = images.rows(rows)
    seen = anti_instagram(chosen.images) if options.anti_instagram else chosen.images
    tuning = tune(seen, chosen.masks)
    if options.json:
        json.dump(tuning_document(tuning), sys.stdout, indent=1)
        print()
    else:
        print(tuning_yaml(tuning), end="")
    return 0


def _report(options: argparse.Namespace) -> int:
    import math

    from s2rtools.common.result_files import write_all
    from s2rtools.lane_detection import experiment_report as report
    from s2rtools.lane_detection.experiment_arms import parse_scopes, parse_sources
    from s2rtools.lane_detection.road_images import read_road_images
    from s2rtools.lane_detection.threshold_experiment import ExperimentSettings, run_experiment

    if options.seeds < 1:
        raise RequestError(f"--seeds {options.seeds}: must be at least 1")
    if options.minutes is not None and not (math.isfinite(options.minutes) and options.minutes > 0):
        raise RequestError(f"--minutes {options.minutes}: must be above 0")
    sources = tuple(parse_sources(options.translators))
    scopes = parse_scopes(options.scopes)
    cache = None
    if options.out is not None:
        try:
            options.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RequestError(f"--out {options.out}: {error.strerror}") from error
        cache = options.out / "translators"
    sim = read_road_images(options.sim, options.crop)
    real = read_road_images(options.real, options.crop)
    settings = ExperimentSettings(options.seeds, options.minutes, cache, sources, scopes)
    with reporter() as progress:
        experiment = run_experiment(sim, real, settings, progress)
    document = report.to_document(experiment)
    table, words = report.to_table(experiment), report.in_words(experiment)
    if options.out is not None:
        write_all(
            {
                options.out / "report.json": report.to_json(document).encode(),
                options.out / "arms.csv": report.to_csv(document).encode(),
                options.out / "figure.png": report.figure_png(experiment),
                options.out / "summary.txt": f"{table}\n\n{words}\n".encode(),
            }
        )
    if options.json:
        print(report.to_json(document), end="")
    else:
        print(f"{table}\n\n{words}")
    return 0

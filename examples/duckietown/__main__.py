"""`python -m examples.duckietown`: the study of colour thresholds, and its parts as commands."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from examples.duckietown import lane_following, report
from examples.duckietown.conditions import CONDITIONS, Condition, find_condition
from examples.duckietown.line_detector import anti_instagram
from examples.duckietown.rendered_folder import write_rendered
from examples.duckietown.road_images import RoadImages, read_road_images
from examples.duckietown.segment_table import SegmentTable
from examples.duckietown.study import StudySettings, run_study
from examples.duckietown.tuning import tune, tuning_document, tuning_yaml
from examples.duckietown.variants import parse_scopes, parse_sources
from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line.progress import Reporter, reporter
from s2rtools.common.result_files import check_writable, write_all
from s2rtools.translation.apply_bag import BagImage, BagRequest, translated_images
from s2rtools.translation.method import Translator
from s2rtools.translation.translator_file import load_translator

SIM_SEED, LIGHTS_SEED = 1, 7
"""Seeds of the rendered simulation and of the rendered lights of the study."""


def main(words: Sequence[str] | None = None) -> int:
    """Run one command; returns 0, or 2 for a wrong request, whose reason is printed in a line."""
    options = _parser().parse_args(words)
    try:
        options.action(options)
    except RequestError as error:
        print(f"duckietown: {printable(str(error))}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m examples.duckietown", description=__doc__)
    actions = parser.add_subparsers(metavar="COMMAND", title="commands", required=True)
    for name, summary, add_arguments, action in (
        ("study", "compare translation with calibration", _add_study, _study),
        ("render", "render road images with exact line masks", _add_render, _render),
        ("tune", "tune HSV ranges on labelled images", _add_tune, _tune),
        ("drive", "follow a lane with and without a translator", _add_drive, _drive),
        ("segments", "translate a bag and list its line segments", _add_segments, _segments),
    ):
        command = actions.add_parser(name, help=summary, description=f"{summary.capitalize()}.")
        add_arguments(command)
        command.set_defaults(action=action)
    return parser


def _add_study(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--real",
        type=Path,
        metavar="DIR",
        help="folder of real images, some of them labelled, judged like the rendered lights",
    )
    add("--out", type=Path, required=True, metavar="DIR",
        help="folder of the results, the rendered images and the fitted translators; a later call "
        "continues with what it finds there")  # fmt: skip
    add("--sim", type=Path, metavar="DIR",
        help="labelled simulated images (default: rendered by day)")  # fmt: skip
    add("--frames", type=int, default=160, metavar="N",
        help="rendered images of the simulation (default %(default)s)")  # fmt: skip
    add("--light-frames", type=int, default=24, metavar="N",
        help="rendered images per light, 0 for none (default %(default)s)")  # fmt: skip
    add("--translators", metavar="NAME,...",
        help="methods (NAME or NAME:OPTION=VALUE) and translator files, or `all` methods; "
        "(default: the methods without training)")  # fmt: skip
    add("--scopes", metavar="SCOPE,...",
        help="real images on which translators are fitted: of the judged `light`, of `all` lights, "
        "of all `others` (default: each of the three)")  # fmt: skip
    add("--seeds", type=int, default=3,
        help="fits per learned method, and draws of labelled images (default 3)")  # fmt: skip
    add("--minutes", type=float, metavar="M", help="time per fit of a learned method")
    _add_crop(parser)
    add("--json", action="store_true", help="print the results as JSON")


def _add_render(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--out", type=Path, required=True, help="new folder for the images")
    add("--frames", type=int, default=200, metavar="N",
        help="images per condition (default %(default)s)")  # fmt: skip
    add("--condition", default="day", metavar="NAME,...",
        help="lights and cameras, or `all` (default day)")  # fmt: skip
    add("--no-lines", action="store_true", help="render roads without lines")
    add("--seed", type=int, default=1, help="random seed (default 1)")


def _add_tune(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=Path, help="folder with images/, masks/ and index.csv")
    add("--condition", metavar="NAME", help="use only images of this condition")
    add("--images", type=int, metavar="K",
        help="use K labelled images, drawn by seed (default: all)")  # fmt: skip
    add("--anti-instagram", action="store_true",
        help="tune for images after the anti-instagram map")  # fmt: skip
    _add_crop(parser)
    add("--seed", type=int, default=1, help="random seed (default 1)")
    add("--json", action="store_true", help="print the ranges as JSON")


def _add_drive(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    _add_translator(parser)
    add("--condition", default="coloured", metavar="NAME,...",
        help="lights, such as dark,warm, or `all` (default coloured)")  # fmt: skip
    add("--tuned-on", default="day", metavar="NAME",
        help="light in which the detector's thresholds are tuned (default day)")  # fmt: skip
    add("--seeds", type=int, default=5, help="drives per light (default 5)")
    add("--seed", type=int, default=1, help="first random seed (default 1)")
    add("--distance", type=float, default=6.0, help="metres of each drive (default 6)")
    add("--json", action="store_true", help="print the result as JSON")


def _add_segments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("bag", type=Path, help="ROS 1 bag, or ROS 2 folder or file")
    _add_translator(parser)
    add("--in", dest="input", metavar="TOPIC",
        help="topic of the images (default: the only one with images)")  # fmt: skip
    add("--out", dest="output", type=Path, required=True, metavar="BAG",
        help="bag with the translated images: .bag for ROS 1, else a ROS 2 folder")  # fmt: skip
    add("--segments", type=Path, required=True, metavar="FILE",
        help="CSV file of the line segments of the translated images")  # fmt: skip


def _add_translator(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--translator", required=True, metavar="FILE", help="translator file (.safetensors)")
    add("--strength", type=float, default=1.0, metavar="S",
        help="share of the translation, 0 to 1 (default 1)")  # fmt: skip


def _add_crop(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--crop", choices=("auto", "none", "top"), default="auto",
                        help="cut the upper third off, or not; auto decides by the aspect ratio "
                        "(default auto)")  # fmt: skip


def _study(options: argparse.Namespace) -> None:
    """Judge the rendered lights and the real images; write the results of each to a folder."""
    _check_at_least(options.seeds, 1, "--seeds")
    if options.minutes is not None and not (math.isfinite(options.minutes) and options.minutes > 0):
        raise RequestError(f"--minutes {options.minutes}: must be above 0")
    settings = StudySettings(
        options.seeds, options.minutes, options.out / "translators",
        tuple(parse_sources(options.translators)), parse_scopes(options.scopes),
    )  # fmt: skip
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RequestError(f"--out {options.out}: {error.strerror}") from error
    documents: dict[str, Any] = {}
    with reporter() as progress:
        for real, sim in _judged_sets(options, progress):
            study = run_study(sim, real, settings, progress)
            document = documents[real.name] = report.to_document(study)
            text = f"{report.to_table(study)}\n\n{report.in_words(study)}\n"
            folder = options.out / real.name
            folder.mkdir(exist_ok=True)
            write_all(
                {
                    folder / "report.json": report.to_json(document).encode(),
                    folder / "variants.csv": report.to_csv(document).encode(),
                    folder / "figure.png": report.figure_png(study),
                    folder / "summary.txt": text.encode(),
                }
            )
            if not options.json:
                print(f"{folder}\n\n{text}")
    if options.json:
        print(report.to_json(documents), end="")


def _judged_sets(
    options: argparse.Namespace, progress: Reporter
) -> list[tuple[RoadImages, RoadImages]]:
    """The sets of images to judge, each with the simulated images."""
    day = [CONDITIONS["day"]]
    sim = options.sim or _rendered(
        options.out / "rendered" / "sim", day, options.frames, SIM_SEED, progress
    )
    folders = [options.real] if options.real is not None else []
    if options.light_frames:
        folder = options.out / "rendered" / "lights"
        lights = list(CONDITIONS.values())
        folders.append(_rendered(folder, lights, options.light_frames, LIGHTS_SEED, progress))
    if not folders:
        raise RequestError("nothing to judge; give --real DIR, or --light-frames above 0")
    simulated = read_road_images(sim, options.crop)
    return [(read_road_images(folder, options.crop), simulated) for folder in folders]


def _rendered(
    folder: Path, conditions: list[Condition], frames: int, seed: int, progress: Reporter
) -> Path:
    """A folder of rendered images, written where it does not exist."""
    if not folder.exists():
        progress.begin(f"images of {folder.name}", max(0, frames) * len(conditions))
        write_rendered(folder, conditions, frames, seed, advance=progress.advance)
    return folder


def _render(options: argparse.Namespace) -> None:
    _check_at_least(options.seed, 0, "--seed")
    conditions = _conditions(options.condition)
    with reporter() as progress:
        progress.begin("images", max(0, options.frames) * len(conditions))
        count = write_rendered(
            options.out, conditions, options.frames, options.seed, not options.no_lines,
            progress.advance,
        )  # fmt: skip
    print(f"{options.out}: {count} images written")


def _conditions(text: str) -> list[Condition]:
    if text == "all":
        return list(CONDITIONS.values())
    names = [name.strip() for name in text.split(",") if name.strip()]
    if not names or len(set(names)) < len(names):
        raise RequestError(f"--condition {text!r}: name each condition once, such as day,dark")
    return [find_condition(name) for name in names]


def _tune(options: argparse.Namespace) -> None:
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
        print(json.dumps(tuning_document(tuning), indent=1))
    else:
        print(tuning_yaml(tuning), end="")


def _drive(options: argparse.Namespace) -> None:
    if not 1 <= options.seeds <= 1000:
        raise RequestError(f"--seeds {options.seeds}: must be 1 to 1000")
    if not 0.1 <= options.distance <= 1000:
        raise RequestError(f"--distance {options.distance}: must be 0.1 to 1000 metres")
    _check_at_least(options.seed, 0, "--seed")
    _check_strength(options.strength)
    conditions, tuned_on = _conditions(options.condition), find_condition(options.tuned_on)
    translator = load_translator(options.translator).translator
    settings = replace(lane_following.DriveSettings(), distance=options.distance)
    seeds = range(options.seed, options.seed + options.seeds)
    with reporter() as progress:
        progress.begin("tune the thresholds", 1)
        thresholds = lane_following.tuned_thresholds(tuned_on, options.seed)
        progress.advance(1)
        progress.begin("drive", 2 * len(conditions) * len(seeds))
        variants = lane_following.compare(
            conditions, seeds, translator, thresholds, options.strength, settings, progress.advance
        )
        rows = [variant.summary() for variant in variants]
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    print(
        f"{'light':<12}{'translator':<12}{'kept the lane':>14}{'route':>8}{'error':>9}{'poses':>8}"
    )
    for row in rows:
        print(
            f"{row['condition']:<12}{'yes' if row['translated'] else 'no':<12}"
            f"{row['kept']:>9} / {row['drives']:<2}{row['progress']:>8.0%}"
            f"{1e3 * row['mean_error_m']:>6.0f} mm{row['detected']:>8.0%}"
        )


def _segments(options: argparse.Namespace) -> None:
    _check_strength(options.strength)
    check_writable({"--segments": options.segments}, {"BAG": options.bag})
    translator = load_translator(options.translator).translator
    table = SegmentTable()
    for stamp, _, translated in _translated_images(options, translator):
        table.add(stamp, translated)
    table.write(options.segments)
    print(f"{options.segments}: {table.segments} segments in {table.images} images")


def _translated_images(options: argparse.Namespace, translator: Translator) -> Iterator[BagImage]:
    """Write the bag and yield every decoded image with its translation."""
    with reporter() as progress:
        result = yield from translated_images(
            translator, options.strength, options.bag, options.output, progress,
            BagRequest(options.input),
        )  # fmt: skip
    print(f"{options.output}: {result.summary()}")


def _check_at_least(value: int, least: int, name: str) -> None:
    if value < least:
        raise RequestError(f"{name} {value}: must be at least {least}")


def _check_strength(strength: float) -> None:
    if not 0 <= strength <= 1:
        raise RequestError(f"--strength {strength:g}: must be 0 to 1")


if __name__ == "__main__":
    sys.exit(main())

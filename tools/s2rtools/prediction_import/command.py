"""`s2r run`: register a run, for `s2r precompute` to compute, or import its predictions."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Mapping

import s2rstore
from s2rtools.common.command_line import store_argument
from s2rtools.common.input_issue import issue_lines

EXAMPLE = """s2r run add bright --model mine --adjust real:brightness=1.15 --store lab.s2r
  s2r run import theirs --predictions theirs.csv --store lab.s2r"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(metavar="ACTION", title="actions", required=True)
    add = actions.add_parser("add", help="register a run of a model")
    _add_common(add)
    add.add_argument("--model", required=True, help="name of a registered model")
    add.add_argument("--adjust", action="append", default=[], metavar="SIDE:NAME=VALUE,...",
                     help="adjustments of the images of one side, such as "
                     "real:brightness=1.15,contrast=1.1 or real:translate=T@0.5")  # fmt: skip

    add.add_argument(
        "--force",
        action="store_true",
        help="use a translator although it failed a check of its content",
    )
    add.set_defaults(action=_add)
    _add_import(actions.add_parser("import", help="import poses that another program predicted"))


def _add_common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", help="name of the run")
    parser.add_argument("--store", type=store_argument.folder, required=True, help="store folder")
    parser.add_argument("--sim", help="domain of the sim side (default: the first of kind sim)")
    parser.add_argument("--real", help="domain of the real side (default: the first of kind real)")


def _add_import(parser: argparse.ArgumentParser) -> None:
    _add_common(parser)
    parser.add_argument("--predictions", action="append", required=True, metavar="[SIDE:]FILE",
                        help="predicted poses: .csv, .parquet or .tum; sim:FILE and real:FILE for "
                        "files of one side, sim/TRAJECTORY:FILE for one recording")  # fmt: skip
    parser.add_argument("--embeddings", action="append", default=[], metavar="[SIDE:]FILE.npy",
                        help="embeddings, a row for each row of the predictions")  # fmt: skip
    parser.add_argument("--units", default="", metavar="UNIT,...",
                        help="units of the file: m, cm or mm; rad or deg; s, ms, us or ns "
                        "(default: s, the others recognised from the values)")  # fmt: skip
    parser.add_argument("--heading", default="map", metavar="FORMULA",
                        help="map heading in degrees for heading h of the file: 0+h (map), 90+h, "
                        "180+h, 270+h, 0-h, 90-h (compass), 180-h, 270-h (habitat), or auto "
                        "(default 0+h)")  # fmt: skip
    parser.add_argument("--tolerance", type=float, default=0.02, metavar="SECONDS",
                        help="largest difference of times that match (default 0.02)")  # fmt: skip
    parser.add_argument("--absent", choices=("failure", "ignore"), default="failure",
                        help="instances without a row, in the recordings that the files cover: "
                        "failure: not localised (default); ignore: not attempted")  # fmt: skip
    parser.set_defaults(action=_import)


def execute(options: argparse.Namespace) -> int:
    return int(options.action(options))


def _add(options: argparse.Namespace) -> int:
    from s2rtools.adjustments import parse_adjustment
    from s2rtools.precompute.run_registration import add_run

    chains: dict[str, list[dict[str, object]]] = {"sim": [], "real": []}
    for text in options.adjust:
        for side, steps in parse_adjustment(text).items():
            chains[side] += steps
    run = add_run(options.store, options.name, options.model, options.sim, options.real, chains,
                  options.force)  # fmt: skip
    with s2rstore.open(options.store) as store:
        trust = " --trust" if store.models[options.model].needs_trust else ""
    command = f"s2r precompute {shlex.quote(str(options.store))}{trust}"
    why = ", which executes the code of its model" if trust else ""
    print(f"{options.store}: run {run} registered; next: `{command}`{why}")
    return 0


def _import(options: argparse.Namespace) -> int:
    from s2rstore.errors import RequestError
    from s2rstore.security.printable_text import printable
    from s2rtools.prediction_import.file_predictions import ReadingOptions
    from s2rtools.prediction_import.import_run import ImportRequest, import_run
    from s2rtools.prediction_import.pose_units import parse_convention, parse_units
    from s2rtools.prediction_import.sided_files import parse_file

    if not 0 < options.tolerance < float("inf"):
        raise RequestError(f"--tolerance {options.tolerance:g}: must be above 0 seconds")
    reading = ReadingOptions(
        parse_units(options.units), parse_convention(options.heading), options.tolerance
    )
    request = ImportRequest(
        [parse_file(text) for text in options.predictions],
        [parse_file(text) for text in options.embeddings],
        options.sim,
        options.real,
        reading,
        shlex.join(["s2r", *sys.argv[1:]]),
        options.absent,
    )
    report = import_run(options.store, options.name, request)
    for line in report.lines:
        print(printable(line))
    for line in issue_lines(report.issues):
        print(line, file=sys.stderr)
    for warning in report.warnings:
        print(printable(f"warning: {warning}"), file=sys.stderr)
    counts, total = report.counts, report.instances
    verb = "imported" if report.is_new else "replaced"
    embeddings = f"embeddings of {report.width} numbers" if report.width else "no embeddings"
    print(
        f"{options.store}: run {options.name} {verb}: {counts['both']} of {total} instances on "
        f"both sides (sim {counts['sim']}, real {counts['real']}){_failures(counts)}; "
        f"{embeddings}; next: "
        f"`s2r precompute {shlex.quote(str(options.store))} --run {options.name}`"
    )
    return 0


def _failures(counts: Mapping[str, int]) -> str:
    """How many instances count as not localised, and how many of these for lack of a row."""
    lost, absent = counts["not_localised"], counts["absent"]
    if not lost:
        return ""
    text = f"; {lost} not localised, which count as failures"
    hint = f" ({absent} of them have no row; --absent ignore leaves these out)"
    return text + hint * bool(absent)

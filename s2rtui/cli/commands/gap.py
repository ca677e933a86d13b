"""`s2r gap`: the reality gap of a run, measured, and judged by a frozen reference."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from s2rtools.gap.gate.gate import GapRequest


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    _add_evidence(parser)
    _add_judges(parser)
    parser.add_argument("--details", action="store_true", help="all figures of every axis")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", type=Path, help="write the report as JSON to this file, too")


def _add_evidence(parser: argparse.ArgumentParser) -> None:
    from s2rtools.gap import defaults
    from s2rtools.gap.axes import AXES

    parser.add_argument("--run", help="default: the first")
    parser.add_argument("--select", default="all", metavar="EXPR", help="only these instances")
    parser.add_argument(
        "--axis", action="append", default=[], choices=AXES, help="only this (repeat)"
    )
    parser.add_argument(
        "--drives", metavar="DIR",
        help="folder of drives (NAME/real.csv, sim.csv, untuned.csv, commands.csv), or "
             f"`{defaults.ODOMETRY}` (default: those in the store)",
    )  # fmt: skip
    parser.add_argument("--rate", type=float, metavar="HZ",
                        help="of odometry that was stored without times")  # fmt: skip
    parser.add_argument(
        "--features", type=Path, metavar="FILE",
        help="description of an image network (default: the model's own embedding)",
    )  # fmt: skip
    parser.add_argument("--anchor-run", metavar="R",
                        help="its sim images are the visual axis' bad state")  # fmt: skip
    parser.add_argument("--topic", help="of the poses in ROS bags")
    parser.add_argument("--dynamics", action="append", default=[], metavar="NAME=VALUE",
                        help="of the axes of motion (repeat): horizons=0.5,1,2 (s); "
                        "nrmse=travel|extent|deviation; align=rigid+reflection+scale, rpe=1s or "
                        "poses, of APE and RPE; reach=1 (s), bad=period|untuned, period=0.05 of "
                        "the delay; noise=0.002,0.003 (m, rad) of the real poses")  # fmt: skip


def _add_judges(parser: argparse.ArgumentParser) -> None:
    from s2rtools.gap import defaults

    parser.add_argument("--freeze", type=Path, metavar="REF", help="write the scale to judge by")
    parser.add_argument("--reference", type=Path, metavar="REF", help="judge by this scale")
    parser.add_argument(
        "--threshold", type=float, default=defaults.THRESHOLD, help="of G (default %(default)g)"
    )
    parser.add_argument("--freeze-golden", type=Path, metavar="FILE", help="accept today's errors")
    parser.add_argument("--golden", type=Path, metavar="FILE", help="no worse than these errors")
    parser.add_argument("--margin", type=float, default=defaults.MARGIN,
                        help="of the golden run, in metres (default %(default)g)")  # fmt: skip
    parser.add_argument(
        "--seed", type=int, default=defaults.SEED, help="of the bootstraps (default %(default)s)"
    )
    parser.add_argument(
        "--replicates",
        type=int,
        default=defaults.REPLICATES,
        help="of the bootstraps (default %(default)s)",
    )
    parser.add_argument(
        "--pca", type=int, default=3, metavar="N",
        help="principal components of the features' divergence (default 3)",
    )  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore.gap_history.gate_status import EXIT_CODES, report_outcome
    from s2rtools.common import result_files
    from s2rtools.gap.gate import gate, golden_run
    from s2rtools.gap.report import report

    request = _request(options)
    _check_places(options)
    made: dict[Path, str] = {}
    with s2rstore.open(options.store) as store:
        evidence = gate.collect_evidence(store, request)
        if options.freeze_golden:
            made[options.freeze_golden] = golden_run.text(golden_run.take(evidence))
        judged = gate.judge_gap(evidence, request)
        if options.freeze:
            judged, made[options.freeze] = gate.freeze(evidence, request, judged)
        found = report(evidence, request.settings, judged)
    froze = tuple(made)
    text = json.dumps(found, indent=1, sort_keys=True, allow_nan=False) + "\n"
    if options.out:
        made[options.out] = text
    result_files.write_all({path: content.encode() for path, content in made.items()})
    if options.json:
        sys.stdout.write(text)
    else:
        from s2rtui.cli.formatting.gap_tables import tables

        print(tables(found, options.details, bool(froze)))
    for path in froze:
        print(f"wrote {path}", file=sys.stderr)
    return EXIT_CODES[report_outcome(found) or ("PASS" if froze else "INCONCLUSIVE")]


def _check_places(options: argparse.Namespace) -> None:
    from s2rtools.common import result_files

    written = {"--freeze": options.freeze, "--freeze-golden": options.freeze_golden,
               "--out": options.out}  # fmt: skip
    read = {"--reference": options.reference, "--golden": options.golden,
            "--features": options.features}  # fmt: skip
    result_files.check_writable(written, read)


def _request(options: argparse.Namespace) -> GapRequest:
    from s2rstore.errors import RequestError
    from s2rtools.gap import defaults
    from s2rtools.gap.axis_result import GapSettings
    from s2rtools.gap.gate.gate import GapRequest

    if options.freeze and options.reference:
        raise RequestError("--freeze and --reference: one writes the scale, the other uses it")
    if options.freeze_golden and options.golden:
        raise RequestError("--freeze-golden and --golden: one writes, the other uses it")
    for name, fewest, most in (
        ("replicates", defaults.MIN_REPLICATES, defaults.MAX_REPLICATES),
        ("seed", 0, defaults.MAX_SEED),
        ("pca", 1, 50),
    ):
        if not fewest <= getattr(options, name) <= most:
            raise RequestError(f"--{name}: {fewest} .. {most}, not {getattr(options, name)}")
    return GapRequest(
        run=options.run,
        expression=options.select,
        axes=tuple(options.axis),
        drives=options.drives,
        rate=options.rate,
        features=options.features,
        anchor_run=options.anchor_run,
        topic=options.topic,
        reference=options.reference,
        golden=options.golden,
        threshold=options.threshold,
        margin=options.margin,
        dynamics=tuple(options.dynamics),
        settings=GapSettings(options.replicates, options.seed, pca=options.pca),
    )

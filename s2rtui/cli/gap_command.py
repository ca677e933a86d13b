"""`s2r gap`: the reality gap of a run, measured, and judged by a frozen reference."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

_AXES = ("visual", "task", "dynamics", "delay")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("--run", help="default: the first")
    parser.add_argument("--select", default="all", metavar="EXPR", help="only these instances")
    parser.add_argument(
        "--axis", action="append", default=[], choices=_AXES, help="only this (repeat)"
    )
    parser.add_argument(
        "--drives", metavar="DIR",
        help="folder of drives (NAME/real.csv, sim.csv, untuned.csv, commands.csv), or `odometry` "
             "(default: those in the store)",
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
                        "poses, of APE and RPE; reach=1 (s), bad=untuned|period, period=0.05 of "
                        "the delay; noise=0.002,0.003 (m, rad) of the real poses")  # fmt: skip
    parser.add_argument("--freeze", type=Path, metavar="REF", help="write the scale to judge by")
    parser.add_argument("--reference", type=Path, metavar="REF", help="judge by this scale")
    parser.add_argument("--threshold", type=float, default=15.0, help="of G (default 15)")
    parser.add_argument("--freeze-golden", type=Path, metavar="FILE", help="accept today's errors")
    parser.add_argument("--golden", type=Path, metavar="FILE", help="no worse than these errors")
    parser.add_argument("--margin", type=float, default=0.05,
                        help="of the golden run, in metres (default 0.05)")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="of the bootstraps (default 1)")
    parser.add_argument("--replicates", type=int, default=1000, help="bootstrap (default 1000)")
    parser.add_argument("--details", action="store_true", help="all figures of every axis")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--out", type=Path, help="write the report as JSON to this file, too")


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rtools.gap import gate, golden
    from s2rtools.gap.files import write_atomically
    from s2rtools.gap.report import report

    request = _request(options)
    with s2rstore.open(options.store) as store:
        evidence = gate.evidence(store, request)
        accepted = golden.take(evidence) if options.freeze_golden else None
        judged = gate.judged(evidence, request)
        if options.freeze:
            gate.freeze(options.freeze, evidence, request, judged.found)
        if accepted:
            golden.write(options.freeze_golden, accepted)
        found = report(evidence, request.settings, judged)
    text = json.dumps(found, indent=1, sort_keys=True, allow_nan=False) + "\n"
    if options.out:
        write_atomically(options.out, text)
    if options.json:
        sys.stdout.write(text)
    else:
        from s2rtui.cli.gap_tables import tables

        print(tables(found, options.details))
    for path in (options.freeze, options.freeze_golden):
        if path:
            print(f"wrote {path}", file=sys.stderr)
    return _exit_code(found, froze=bool(options.freeze or options.freeze_golden))


def _request(options: argparse.Namespace) -> Any:
    from s2rstore.errors import RequestError
    from s2rtools.gap.contract import Settings
    from s2rtools.gap.gate import Request

    if options.freeze and options.reference:
        raise RequestError("--freeze and --reference: one writes the scale, the other uses it")
    if options.freeze_golden and options.golden:
        raise RequestError("--freeze-golden and --golden: one writes, the other uses it")
    if not 100 <= options.replicates <= 100_000:
        raise RequestError(f"--replicates: 100 .. 100000, not {options.replicates}")
    if not 0 <= options.seed < 2**31:
        raise RequestError(f"--seed: 0 .. 2147483647, not {options.seed}")
    return Request(
        options.run, options.select, tuple(options.axis), options.drives, options.rate,
        options.features, options.anchor_run, options.topic, options.reference, options.golden,
        options.threshold, options.margin, tuple(options.dynamics),
        Settings(options.replicates, options.seed),
    )  # fmt: skip


def _exit_code(found: dict[str, Any], froze: bool) -> int:
    """The worst of what was judged; freezing is done when it is written."""
    from s2rtools.gap.verdict import EXIT_CODES

    outcomes = [found["golden"]["outcome"]] if found["golden"] else []
    if found["reference"] or not (outcomes or froze):
        outcomes.append(found["verdict"]["outcome"])
    codes = {EXIT_CODES[outcome] for outcome in outcomes}
    return next((code for code in (1, 3) if code in codes), 0)

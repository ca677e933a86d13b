"""`s2r gap`: measure the reality gap of a run and judge it by a frozen reference."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.common.command_line import store_argument
from s2rtools.common.command_line.assignments import parse_assignments
from s2rtools.common.command_line.output import print_coverage

if TYPE_CHECKING:
    from s2rtools.gap.gate.gate import GapRequest
EXAMPLE = "s2r gap lab.s2r --reference reference.json --golden golden.json --details"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from s2rtools.gap.axes import AXES, MARGIN, ODOMETRY, SEED, THRESHOLD, flags, options_of

    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--run", help="run to measure (default: the first)")
    parser.add_argument("--select", default="all", metavar="EXPR",
                        help="measure only the selected instances (default all)")  # fmt: skip
    parser.add_argument("--axis", action="append", default=[], choices=AXES,
                        help="measure only this axis (repeatable)")  # fmt: skip
    add = parser.add_argument_group("evidence").add_argument
    add("--features", type=Path, metavar="FILE",
        help="description of an image network whose features are compared "
        "(default: the embedding of the model)")  # fmt: skip
    add("--anchor-run", metavar="RUN", help="run whose sim images define a gap of 100")
    add(
        "--drives", metavar="DIR",
        help="folder of drives (NAME/real.csv, sim.csv, untuned.csv, commands.csv), or "
        f"`{ODOMETRY}` (default: the drives in the store)",
    )  # fmt: skip
    add("--topic", help="ROS topic that carries the poses")
    add("--rate", type=float, metavar="HZ",
        help="rate of odometry that has no times; the time of an instance is seq / HZ")  # fmt: skip
    add = parser.add_argument_group("options of the axes").add_argument
    for name, text in options_of(None).items():
        add(f"--{name}", metavar="N", help=text)
    for flag in flags():
        texts = "; ".join(f"{name}={text}" for name, text in options_of(flag).items())
        add(flag, action="append", default=[], metavar="NAME=VALUE",
            help=f"setting (repeatable): {texts}")  # fmt: skip
    add = parser.add_argument_group("gate").add_argument
    add("--freeze", type=Path, metavar="FILE",
        help="write the reference scale that later runs are judged by")  # fmt: skip
    add("--reference", type=Path, metavar="FILE", help="judge the gap by this reference scale")
    add("--threshold", type=float, default=THRESHOLD, metavar="G",
        help="largest gap that passes (default %(default)g)")  # fmt: skip
    add("--freeze-golden", type=Path, metavar="FILE", help="write the errors as the golden run")
    add("--golden", type=Path, metavar="FILE", help="fail if errors are worse than this golden run")
    add("--margin", type=float, default=MARGIN, metavar="METRES",
        help="tolerance of the golden run (default %(default)g)")  # fmt: skip
    add("--seed", type=int, default=SEED,
        help="seed of random splits (default %(default)s)")  # fmt: skip
    add = parser.add_argument_group("output").add_argument
    add("--details", action="store_true", help="print all figures of every axis")
    add("--json", action="store_true", help="print the report as JSON")
    add("--out", type=Path, metavar="FILE", help="write the report as JSON to this file as well")


def execute(options: argparse.Namespace) -> int:
    from s2rstore.gap_history.gate_status import EXIT_CODES, report_outcome
    from s2rtools.common import result_files
    from s2rtools.gap.gate import gate, golden_run
    from s2rtools.gap.report import gap_text, report

    request = _request(options)
    written = {"--freeze": options.freeze, "--freeze-golden": options.freeze_golden,
               "--out": options.out}  # fmt: skip
    read = {"--reference": options.reference, "--golden": options.golden,
            "--features": options.features}  # fmt: skip
    result_files.check_writable(written, read)
    files: dict[Path, str] = {}
    with s2rstore.open(options.store) as store:
        evidence = gate.collect_evidence(store, request)
        print_coverage(store, [evidence.run, evidence.anchor_run])
        if options.freeze_golden:
            files[options.freeze_golden] = golden_run.text(golden_run.take(evidence))
        judged = gate.judge_gap(evidence, request)
        if options.freeze:
            judged, files[options.freeze] = gate.freeze(evidence, request, judged)
        result = report(evidence, request.settings, judged)
    frozen = tuple(files)
    text = json.dumps(result, indent=1, sort_keys=True, allow_nan=False) + "\n"
    if options.out:
        files[options.out] = text
    result_files.write_all({path: content.encode() for path, content in files.items()})
    if options.json:
        sys.stdout.write(text)
    else:
        print(gap_text(result, options.details, bool(frozen)))
    for path in frozen:
        print(f"wrote {path}", file=sys.stderr)
    return EXIT_CODES[report_outcome(result) or ("PASS" if frozen else "INCONCLUSIVE")]


def _request(options: argparse.Namespace) -> GapRequest:
    from s2rtools.gap.axes import MAX_SEED, flags, options_of
    from s2rtools.gap.axis import GapSettings
    from s2rtools.gap.gate.gate import GapRequest

    if options.freeze and options.reference:
        raise RequestError("--freeze and --reference: one writes the scale, the other reads it")
    if options.freeze_golden and options.golden:
        raise RequestError("--freeze-golden and --golden: one writes the file, the other reads it")
    if not 0 <= options.seed <= MAX_SEED:
        raise RequestError(f"--seed {options.seed}: must be 0 to {MAX_SEED}")
    given = {name: getattr(options, name) for name in options_of(None)}
    texts = {name: text for name, text in given.items() if text is not None}
    for flag in flags():
        arguments = getattr(options, flag.removeprefix("--"))
        texts |= parse_assignments(flag, arguments, options_of(flag))
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
        options=texts,
        settings=GapSettings(seed=options.seed),
    )

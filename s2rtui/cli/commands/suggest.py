"""`s2r suggest`: search the smallest change that closes the gap, judged on held-out instances."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.errors import RequestError, counted
from s2rstore.records import SIDES, Run
from s2rstore.security.printable_text import printable
from s2rtui.cli import store_argument
from s2rtui.cli.formatting import rows as output
from s2rtui.cli.formatting.progress import reporter

if TYPE_CHECKING:
    from s2rstore.metrics.bootstrap import Interval
    from s2rtools.suggestions.answers import Answer, SuggestReport

EXAMPLE = """s2r suggest world.s2r --run vanilla --for sim --budget 5m
  s2r suggest world.s2r --run vanilla --for sim --apply 1 --name tuned"""
_NOTHING_HELPS = 3
_AIMS = {
    "real": "adapt the real images so that the model works",
    "sim": "tune the simulator so that it predicts the real images and errors",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--run", help="computed run (default: the first)")
    parser.add_argument("--for", dest="side", choices=SIDES, default="real",
                        help="real: adapt the real images so that the model works; sim: tune the "
                        "simulator so that it predicts reality (default real)")  # fmt: skip
    add = parser.add_argument_group("search").add_argument
    add("--budget", default="5m", metavar="TIME",
        help="wall time of search and judgement, such as 90s or 5m (default 5m)")  # fmt: skip
    add("--evaluations", type=int, default=100,
        help="most evaluations of each joint search by CMA-ES (default 100)")  # fmt: skip
    add("--frames", type=int, default=48, help="instances of the fit (default 48)")
    add("--changes", type=int, default=4, help="most adjustments that change (default 4)")
    add("--price", default="2%", metavar="SHARE",
        help="share of the error or mismatch that each change must gain (default 2%%)")  # fmt: skip
    add("--seed", type=int, default=1, help="random seed (default 1)")
    add("--trust", action="store_true", help="allow model formats that execute code")
    add = parser.add_argument_group("output").add_argument
    add("--apply", type=int, metavar="N",
        help="register answer N as a run; of the stored result, if there is one")  # fmt: skip
    add("--name", help="name of the run that --apply registers")
    add("--figure", type=Path, metavar="FILE", help="draw the front as PNG, SVG or PDF")
    add("--no-keep", action="store_true", help="do not save the result in the store")
    add("--json", action="store_true", help="print the result as JSON")


def execute(options: argparse.Namespace) -> int:
    from s2rtools.suggestions import SuggestSettings, suggest
    from s2rtools.suggestions.front_figure import is_figure, write_front
    from s2rtools.suggestions.settings import parse_duration, parse_share
    from s2rtools.suggestions.stored_reports import apply_answer, save_report

    settings = SuggestSettings(
        side=options.side, budget=parse_duration(options.budget), evaluations=options.evaluations,
        seed=options.seed, price=parse_share(options.price), changes=options.changes,
        frames=options.frames, trust=options.trust,
    )  # fmt: skip
    if options.name is not None and options.apply is None:
        raise RequestError("--name: names the run of --apply; add --apply N")
    if options.figure is not None and not is_figure(options.figure):
        raise RequestError(f"--figure {options.figure}: must end in .png, .svg or .pdf")
    if not options.no_keep or options.apply is not None:
        _check_writable(options.store)
    report = _stored(options) if options.apply is not None else None
    is_new = report is None
    if report is None:
        with reporter() as progress:
            report = suggest(options.store, options.run, settings, progress)
        if not options.no_keep and not report.is_unfinished:
            save_report(options.store, report)
    if options.figure is not None:
        write_front(report, options.figure)
    with s2rstore.open(options.store) as store:
        run = store.run(report.run)
    if options.json:
        commands = [answer.command(str(options.store), run, report.side)
                    for answer in report.answers]  # fmt: skip
        json.dump({**report.as_json(), "commands": commands}, sys.stdout, indent=1)
        print()
    elif is_new:
        for line in _lines(report, run, str(options.store)):
            print(printable(line))
    if options.apply is not None:
        name = apply_answer(options.store, report, options.apply, options.name)
        if not report.answers[options.apply - 1].evident:
            note = f"answer {options.apply} is not shown to help; it is registered all the same"
            print(printable(note), file=sys.stderr)
        where = shlex.quote(str(options.store))
        message = f"{options.store}: run {name} registered; next: `s2r precompute {where}`"
        print(printable(message), file=sys.stderr if options.json else sys.stdout)
        return 0
    return 0 if report.helps else _NOTHING_HELPS


def _check_writable(store: Path) -> None:
    """Raise RequestError, before the search begins, if its result cannot be stored."""
    from s2rstore.index.transaction import check_writable

    s2rstore.open(store).close()
    try:
        check_writable(store)
    except RequestError as error:
        raise RequestError(f"{error}; use --no-keep to print the result only") from error


def _stored(options: argparse.Namespace) -> SuggestReport | None:
    from s2rtools.suggestions.stored_reports import read_report

    with s2rstore.open(options.store) as store:
        return read_report(store, store.run_name(options.run), options.side)


def _lines(report: SuggestReport, run: Run, store: str) -> list[str]:
    lines = [f"{report.run}, --for {report.side}: {_AIMS[report.side]}", *_evidence(report)]
    if report.factors:
        lines += ["", *_factors(report)]
    if report.answers:
        lines += ["", *_front(report), ""]
        for number, answer in enumerate(report.answers, 1):
            lines += _details(report, number, answer)
        lines += ["apply with --apply N, or:"]
        lines += [f"{number}  {answer.command(store, run, report.side)}"
                  for number, answer in enumerate(report.answers, 1)]  # fmt: skip
    lines += ["", _verdict(report)]
    return lines


def _evidence(report: SuggestReport) -> list[str]:
    before = f"real error {report.before:.2f} m"
    if report.side == "sim":
        before = f"mismatch of the images {report.before:.3g}"
    lines = [
        f"{before}, gap {_bounds(report.gap, 'm', signed=True)}, on {report.judged_instances} "
        f"held-out instances; fitted on {report.fitted_instances} others, "
        f"{counted(report.evaluations, 'evaluation')}, seed {report.seed}"
    ]
    if not report.complete:
        lines.append("the time was used up before the search ended; --budget allows more")
    return lines


def _factors(report: SuggestReport) -> list[str]:
    rows = [
        (each.factor, ", ".join(f"{name}={value:g}" for name, value in each.values.items()),
         _gain(report, each.fitted), _gain_bounds(report, each.gain))
        for each in report.factors
    ]  # fmt: skip
    level = f"{100 * report.factors[0].gain.level:.3g} %"
    names = ("factor alone", "values", "gain on the fit", f"held-out gain ({level})")
    return output.table(names, rows).splitlines()


def _front(report: SuggestReport) -> list[str]:
    rows = []
    for number, answer in enumerate(report.answers, 1):
        mark = "*" if number - 1 == report.best else " " if answer.evident else "?"
        rows.append(
            (f"{mark}{number}", len(answer.changes), answer.factor, _changes(answer),
             _gain(report, answer.fitted), _gain_bounds(report, answer.gain))
        )  # fmt: skip
    level = f"{100 * report.answers[0].gain.level:.3g} %"
    names = ("", "changes", "factor", "values", "gain on the fit", f"held-out gain ({level})")
    return output.table(names, rows).splitlines()


def _details(report: SuggestReport, number: int, answer: Answer) -> list[str]:
    lines = []
    for change in answer.changes:
        if change.interval is None:
            continue
        truth = "" if change.truth is None else f", true {change.truth:g}"
        low, high = (f"{bound:.3g}" for bound in (change.interval.low, change.interval.high))
        lines.append(f"{number}  {change.name}={change.value:g} ({low} .. {high}){truth}")
    made = answer.agreement
    if made is not None:
        lines.append(
            f"{number}  sim error {made.sim_error_before:.2f} -> {made.sim_error:.2f} m, real "
            f"{made.real_error:.2f} m; shift {made.shift_before:.2f} -> {made.shift:.2f} m, closer "
            f"by {_bounds(made.closer, 'm')}; correlation of errors "
            f"{made.correlation_before:.2f} -> {made.correlation:.2f}"
        )
    return [*lines, ""] if lines else []


def _verdict(report: SuggestReport) -> str:
    if report.best is None:
        return f"{'not known' if report.is_unfinished else 'nothing helps'}: {report.reason}"
    answer = report.answers[report.best]
    return (
        f"suggested: {_changes(answer)} ({answer.factor}), which gains "
        f"{_gain_bounds(report, answer.gain)} on held-out instances"
    )


def _changes(answer: Answer) -> str:
    return ", ".join(f"{change.name}={change.value:g}" for change in answer.changes)


def _gain(report: SuggestReport, value: float) -> str:
    return f"{value:+.3f} m" if report.side == "real" else f"{100 * value:+.1f} %"


def _gain_bounds(report: SuggestReport, gain: Interval) -> str:
    if report.side == "real":
        return _bounds(gain, "m", signed=True, digits=3)
    low, high = (100 * bound for bound in (gain.low, gain.high))
    text = "interval unknown" if math.isnan(low) else f"{low:.1f} .. {high:.1f}"
    return f"{100 * gain.value:+.1f} % ({text})"


def _bounds(interval: Interval, unit: str, signed: bool = False, digits: int = 2) -> str:
    form = f"{'+' if signed else ''}.{digits}f"
    if math.isnan(interval.low):
        return f"{interval.value:{form}} {unit} (interval unknown)"
    return f"{interval.value:{form}} {unit} ({interval.low:{form}} .. {interval.high:{form}})"

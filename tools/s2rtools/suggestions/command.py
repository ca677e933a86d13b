"""`s2r suggest`: search the smallest change that closes the gap, judged on held-out instances."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import s2rstore
from s2rstore.errors import RequestError, counted
from s2rstore.records import SIDES, Run
from s2rstore.security.printable_text import printable
from s2rstore.suggestions import Answer, SuggestReport, bounds_text, read_report, section
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.command_line.progress import add_progress, reporter
from s2rtools.simulated_frames.command import add_processes, refuse

if TYPE_CHECKING:
    from s2rtools.suggestions.renderer_search import FittedValue, RendererReport
    from s2rtools.suggestions.settings import SuggestSettings

EXAMPLE = """s2r suggest world.s2r --run vanilla --for sim --budget 5m
  s2r suggest world.s2r --run vanilla --for sim --apply 1 --name tuned
  s2r suggest lab.s2r --for sim --renderer 'python my_sim.py' --workers 2 --budget 30m"""
_NOTHING_HELPS = 3
_SEARCH_DEFAULTS: dict[str, Any] = {
    "budget": "5m", "evaluations": 100, "frames": 48, "changes": 4, "price": "2%", "seed": 1,
}  # fmt: skip
"""Options of the search, which a stored result leaves without use."""
_RENDERER_DEFAULTS: dict[str, Any] = {"budget": "30m", "frames": 32, "changes": 4, "price": "2%"}
"""Options of the search for the parameters of a renderer, with their defaults."""
_RENDERER_JUDGED = 64


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    parser.add_argument("--run", help="computed run (default: the first)")
    parser.add_argument("--for", dest="side", choices=SIDES, default="real",
                        help="real: adapt the real images so that the model works; sim: tune the "
                        "simulator so that it predicts reality (default real)")  # fmt: skip
    add = parser.add_argument_group("search").add_argument
    add("--budget", metavar="TIME",
        help="wall time of search and judgement, such as 90s or 5m (default 5m, with --renderer "
        "30m)")  # fmt: skip
    add("--evaluations", type=int,
        help="most evaluations of each joint search by CMA-ES (default 100)")  # fmt: skip
    add("--frames", type=int, help="instances of the fit (default 48, with --renderer 32)")
    add("--changes", type=int, help="most adjustments that change (default 4)")
    add("--price", metavar="SHARE",
        help="share of the error or mismatch that each change must gain (default 2%%)")  # fmt: skip
    add("--seed", type=int, help="random seed (default 1)")
    add("--trust", action="store_true", help="allow model formats that execute code")
    group = parser.add_argument_group("your own simulator (--for sim)")
    group.add_argument("--renderer", metavar="COMMAND",
                       help="program that speaks the renderer protocol, as of `s2r render`: search "
                       "the parameters that it declares, on the real images of the "
                       "store")  # fmt: skip
    add_processes(group)
    group.add_argument("--out", type=Path, metavar="DIR",
                       help="folder of the rendered frames (default: STORE-frames); frames that it "
                       "has are not rendered again")  # fmt: skip
    add = parser.add_argument_group("output").add_argument
    add("--apply", type=int, metavar="N",
        help="register answer N as a run; of the stored result, if there is one, and then without "
        "options of the search")  # fmt: skip
    add("--name", help="name of the run that --apply registers")
    add("--figure", type=Path, metavar="FILE", help="draw the front as PNG, SVG or PDF")
    add("--no-keep", action="store_true", help="do not save the result in the store")
    add("--json", action="store_true", help="print the result as JSON")
    add_progress(parser)


def execute(
    options: argparse.Namespace,
    write_figure: Callable[[SuggestReport, Run, argparse.Namespace], None],
) -> int:
    """Run the command; `write_figure` writes the file of `--figure`, which is checked already."""
    if options.renderer is not None:
        return _execute_renderer(options)
    refuse(options, ("out", "workers", "timeout"), "only with --renderer")
    from s2rtools.suggestions.suggest import suggest

    given = [name for name in _SEARCH_DEFAULTS if getattr(options, name) is not None]
    settings = _settings(options)
    _check_outputs(options)
    report = _stored(options) if options.apply is not None else None
    is_new = report is None
    if report is None:
        with reporter(options.progress) as progress:
            report = suggest(options.store, options.run, settings, progress)
        if not options.no_keep and not report.is_unfinished:
            save_report(options.store, report)
    elif given:
        raise RequestError(
            f"--{given[0]}: --apply takes the stored result of run {report.run}, --for "
            f"{report.side}; leave it out, or search first without --apply"
        )
    with s2rstore.open(options.store) as store:
        run = store.run(report.run)
    if options.figure is not None:
        write_figure(report, run, options)
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


def _execute_renderer(options: argparse.Namespace) -> int:
    """Search the parameters of a renderer program; nothing is saved in the store."""
    from s2rtools.simulated_frames import pose_renderer
    from s2rtools.suggestions.renderer_search import suggest_parameters

    unused = ("run", "evaluations", "seed", "trust", "apply", "name", "figure", "no_keep")
    refuse(options, unused, "not with --renderer")
    if options.side != "sim":
        raise RequestError("--renderer: needs --for sim")
    settings = replace(_settings(options, _RENDERER_DEFAULTS), judged=_RENDERER_JUDGED)
    pose_renderer.check_processes(options.workers, options.timeout)
    command = pose_renderer.renderer_command(options.renderer)
    path = pose_renderer.frames_path(options.store, options.out)
    with reporter(options.progress) as progress:
        report = suggest_parameters(
            options.store, command, path, options.workers, options.timeout, settings, progress
        )
    if options.json:
        json.dump(report.as_json(), sys.stdout, indent=1)
        print()
    else:
        for line in _renderer_lines(report, options.store, options.renderer):
            print(printable(line))
    return 0 if report.helps else _NOTHING_HELPS


def _settings(
    options: argparse.Namespace, defaults: Mapping[str, Any] = _SEARCH_DEFAULTS
) -> SuggestSettings:
    """The settings of the search. Raises RequestError for values out of range."""
    from s2rtools.suggestions.settings import SuggestSettings, parse_duration, parse_share

    chosen = {
        name: default if getattr(options, name) is None else getattr(options, name)
        for name, default in defaults.items()
    }
    chosen["budget"], chosen["price"] = (
        parse_duration(chosen["budget"]), parse_share(chosen["price"])
    )  # fmt: skip
    return SuggestSettings(side=options.side, trust=options.trust, **chosen)


def _check_outputs(options: argparse.Namespace) -> None:
    """Raise RequestError, before the search begins, if its result cannot be written."""
    from s2rstore.index.transaction import check_writable
    from s2rtools.precompute.run_registration import check_run_name

    if options.name is not None and options.apply is None:
        raise RequestError("--name: names the run of --apply; add --apply N")
    if options.apply is not None and options.apply < 1:
        raise RequestError(f"--apply {options.apply}: answers are counted from 1")
    with s2rstore.open(options.store) as store:
        store.run(options.run)
        if options.name is not None:
            check_run_name(store, options.name)
    if not options.no_keep or options.apply is not None:
        try:
            check_writable(options.store)
        except RequestError as error:
            raise RequestError(f"{error}; use --no-keep to print the result only") from error


def _stored(options: argparse.Namespace) -> SuggestReport | None:
    with s2rstore.open(options.store) as store:
        return read_report(store, store.run_name(options.run), options.side)


def save_report(root: Path, report: SuggestReport) -> None:
    """Publish a report in the store, in place of an earlier one of the same run and side."""
    from s2rstore.index.transaction import edit

    with edit(root) as draft:
        draft.set_provenance(section(report.run), {report.side: report.as_json()})


def apply_answer(root: Path, report: SuggestReport, number: int, name: str | None) -> str:
    """Register answer `number`, counted from 1, as a run; return the run's name.

    Raises RequestError for a number that the report does not have, and as `add_run` does.
    """
    from s2rtools.precompute.run_registration import add_run

    if not 1 <= number <= len(report.answers):
        known = f"1 .. {len(report.answers)}" if report.answers else "it has no answer"
        raise RequestError(f"--apply {number}: no answer of that number ({known})")
    answer = report.answers[number - 1]
    with s2rstore.open(root) as store:
        run = store.run(report.run)
    chains = {"sim": run.sim_adjustments, "real": run.real_adjustments}
    chains[report.side] = [dict(step) for step in answer.chain]
    return add_run(
        root, name or f"{run.run}-{answer.default_name}", run.network("suggestions"),
        run.sim_domain, run.real_domain, chains,
    )  # fmt: skip


def _lines(report: SuggestReport, run: Run, store: str) -> list[str]:
    lines = [f"{report.run}, --for {report.side}: {report.aim}", *_evidence(report)]
    if report.factors:
        lines += ["", *_factors(report)]
    if report.answers:
        lines += ["", *_front(report), ""]
        for number, answer in enumerate(report.answers, 1):
            lines += _details(number, answer)
        how = "apply with --apply N, or:"
        if report.is_unfinished:
            how = "not stored, because the search was not finished; apply all the same with:"
        lines += [how]
        lines += [f"{number}  {answer.command(store, run, report.side)}"
                  for number, answer in enumerate(report.answers, 1)]  # fmt: skip
    lines += ["", report.verdict]
    return lines


def _evidence(report: SuggestReport) -> list[str]:
    before = f"real error {report.before:.2f} m"
    if report.side == "sim":
        before = f"mismatch of the images {report.before:.3g}"
    lines = [
        f"{before}, gap {bounds_text(report.gap, 'm', signed=True)}, on {report.judged_instances} "
        f"held-out instances; fitted on {report.fitted_instances} others, "
        f"{counted(report.evaluations, 'evaluation')}, seed {report.seed}"
    ]
    if not report.complete:
        lines.append("the time was used up before the search ended; --budget allows more")
    return lines


def _factors(report: SuggestReport) -> list[str]:
    rows = [
        (each.factor, ", ".join(f"{name}={value:g}" for name, value in each.values.items()),
         report.gain_text(each.fitted), report.gain_interval(each.gain))
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
            (f"{mark}{number}", len(answer.changes), ", ".join(answer.factors), answer.changes_text,
             report.gain_text(answer.fitted), report.gain_interval(answer.gain))
        )  # fmt: skip
    level = f"{100 * report.answers[0].gain.level:.3g} %"
    names = ("", "changes", "factors", "values", "gain on the fit", f"held-out gain ({level})")
    return output.table(names, rows).splitlines()


def _details(number: int, answer: Answer) -> list[str]:
    lines = []
    for change in answer.changes:
        if change.interval is None:
            continue
        truth = "" if change.truth is None else f", true {change.truth:g}"
        bounds = change.interval.bounds_text("{:.3g}".format, to=" .. ")
        lines.append(f"{number}  {change.name}={change.value:g} ({bounds}){truth}")
    made = answer.agreement
    if made is not None:
        lines.append(
            f"{number}  sim error {made.sim_error_before:.2f} -> {made.sim_error:.2f} m, real "
            f"{made.real_error:.2f} m; shift {made.shift_before:.2f} -> {made.shift:.2f} m, closer "
            f"by {bounds_text(made.closer, 'm')}; correlation of errors "
            f"{made.correlation_before:.2f} -> {made.correlation:.2f}"
        )
    return [*lines, ""] if lines else []


def _renderer_lines(report: RendererReport, store: Path, command: str) -> list[str]:
    lines = [
        f"{report.renderer} {report.version}, fitted to the real images of domain {report.domain}",
        f"mismatch of the images {report.before:.3g} -> {report.after:.3g} on "
        f"{report.judged_instances} held-out instances: "
        f"{report.lowered.scaled(100).with_bounds('{:.1f}'.format)} % less; fitted on "
        f"{report.fitted_instances} others, {counted(report.frames, 'frame')} compared",
    ]
    if not report.complete:
        lines.append("the time was used up before the search ended, so that ranges may miss the "
                     "best values; --budget allows more")  # fmt: skip
    lines += ["", *_fitted_rows("parameter", report.parameters)]
    if report.adjustments:
        lines += ["", *_fitted_rows("adjustment", report.adjustments)]
    if not report.helps:
        return [*lines, "", "nothing helps: no range without its default lowers the mismatch of "
                "held-out images evidently"]  # fmt: skip
    values = " ".join(f"--set {each.name}={each.value:g}"
                      for each in report.parameters if each.changed)  # fmt: skip
    if values:
        words = shlex.join(["s2r", "render", str(store), "--renderer", command])
        lines += ["", f"render with these values: {words} {values} --random 100"]
    return lines


def _fitted_rows(kind: str, fitted: Sequence[FittedValue]) -> list[str]:
    rows = [
        (each.name, each.unit, f"{each.default:g}",
         f"{each.value:.4g}" if each.changed else "unchanged",
         each.range.bounds_text("{:.4g}".format, to=" .. "))
        for each in fitted
    ]  # fmt: skip
    level = f"{100 * fitted[0].range.level:.3g} %"
    return output.table((kind, "unit", "default", "value", f"range ({level})"), rows).splitlines()

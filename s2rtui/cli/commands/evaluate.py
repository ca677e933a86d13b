"""`s2r evaluate`: a run in reality, what simulation adds, and how many more images decide."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import s2rstore
from s2rstore.errors import RequestError, counted
from s2rstore.files.planned_poses import read_pose_sample
from s2rstore.intervals import Interval
from s2rstore.security.printable_text import printable
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.command_line.output import print_coverage

if TYPE_CHECKING:
    from s2rstore.intervals.simulation import WithSimulation
    from s2rstore.metrics.evaluation import Evaluation, Figure
    from s2rstore.metrics.exchange import ExchangeChange
    from s2rstore.reader import Store

EXAMPLE = "s2r evaluate lab.s2r --run vanilla --against finetune --target 0.2"
_NAMES = ("figure", "real images alone", "with simulation", "correlation", "exchange rate",
          "effective n")  # fmt: skip
_ROOMS = ("room", "n", "mean error m", "deviation m", "correlation", "exchange rate",
          "share of further images")  # fmt: skip
_RUNS = ("run", "model", "n", "mean error m", "with simulation m", "correlation", "exchange rate",
         "before its changes")  # fmt: skip
_LITTLE = 1.05
"""Exchange rate below which simulation is said to add nearly nothing."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    add = parser.add_argument_group("selection").add_argument
    add("--run", help="run to evaluate (default: the first)")
    add("--against", metavar="RUN", help="also compare with this run")
    add = parser.add_argument_group("plan").add_argument
    add("--target", type=float, metavar="METRES",
        help="say how many more real images give the mean error an interval this wide on either "
        "side")  # fmt: skip
    add("--power", type=float, metavar="P",
        help="probability with which the planned images decide between the two runs "
        "(default 0.8)")  # fmt: skip
    add("--rooms", action="store_true",
        help="list the rooms, their exchange rates and where to take further images")  # fmt: skip
    add("--runs", action="store_true",
        help="list the exchange rates of all runs, with those before their images were "
        "changed")  # fmt: skip
    add("--sample", type=Path, metavar="FILE.csv",
        help="poses of `s2r collect --for evaluation`: give the mean error over the candidates "
        "by the images at them, with or without sim images")  # fmt: skip
    add = parser.add_argument_group("output").add_argument
    add("--json", action="store_true", help="print JSON")


def execute(options: argparse.Namespace) -> int:
    from s2rstore.metrics.evaluation import evaluate
    from s2rstore.metrics.more_images import POWER
    from s2rstore.metrics.sampled_mean import sampled_mean

    if options.target is not None and not 0 < options.target < math.inf:
        raise RequestError(f"--target {options.target:g}: expected metres above 0")
    if options.power is not None and options.against is None:
        raise RequestError("--power: is about a comparison; name the other run by --against")
    power = POWER if options.power is None else options.power
    if not 0 < power < 1:
        raise RequestError(f"--power {power:g}: expected a probability between 0 and 1")
    poses = None if options.sample is None else read_pose_sample(options.sample)
    with s2rstore.open(options.store) as store:
        store.require_poses("evaluate")
        run = store.run_name(options.run)
        other = None if options.against is None else store.run_name(options.against)
        if other == run:
            raise RequestError(f"--against {other}: this is the evaluated run itself")
        print_coverage(store, [run, other])
        sample = None if poses is None else sampled_mean(store, run, poses)
        found: Evaluation | RequestError
        try:
            found = evaluate(store, run, other, options.target, power)
        except RequestError as error:
            if sample is None:
                raise
            found = error
        changes = _changes(store) if options.runs else []
        models = {name: record.model for name, record in store.runs.items()}
    if options.json:
        content: dict[str, Any] = {"run": run, "reason": str(found)}
        if not isinstance(found, RequestError):
            content = found.as_json()
        if sample is not None:
            content["sample"] = sample.as_json()
        if options.runs:
            content["runs"] = [each.as_json() for each in changes]
        json.dump(content, sys.stdout, indent=1, allow_nan=False)
        sys.stdout.write("\n")
        return 0
    if isinstance(found, RequestError):
        print(printable(str(found)))
    else:
        print("\n".join(_lines(found, options.rooms)))
    if sample is not None:
        print(f"\n{printable(sample.text)}")
    if options.runs:
        rows = [_run_row(each, models[each.run]) for each in changes]
        print("\n" + output.table(_RUNS, rows).rstrip())
    return 0


def _changes(store: Store) -> list[ExchangeChange]:
    """The exchange rates of all computed runs that have new pairs."""
    from s2rstore.metrics.exchange import exchange_change

    found = []
    for name in [each.run for each in store.runs.values() if each.key]:
        with contextlib.suppress(RequestError):
            found.append(exchange_change(store, name))
    return found


def _run_row(change: ExchangeChange, model: str | None) -> tuple[object, ...]:
    mean, before = change.after, change.before
    return (
        change.run, model, mean.n, _text(mean.real_only),
        _text(mean.combined) if mean.simulated else None, _text(mean.correlation),
        _text(mean.rate, 1), before and f"{_text(before.rate, 1) or '-'} ({change.changes})",
    )  # fmt: skip


def _lines(found: Evaluation, with_rooms: bool) -> list[str]:
    """The evaluation as text."""
    visits = f"{found.trajectories} {'trajectory' if found.trajectories == 1 else 'trajectories'}"
    further = counted(found.simulated, "instance") if found.simulated else "no instance"
    lines = [
        f"run {found.run}: {found.pairs} pairs of {visits}, new to the run; {further} with a sim "
        "image alone", "", *_table(found.figures), "", _worth(found.figures[0].estimate),
    ]  # fmt: skip
    if found.other is not None:
        head = f"run {found.run} minus run {found.other}:"
        lines += ["", head, *_table(found.differences), "", _decision(found)]
    if with_rooms:
        rows = [
            (each.room, each.n, round(each.mean, 2), round(each.deviation, 2),
             _text(each.correlation), _text(each.rate, 1), f"{each.share:.0%}")
            for each in found.rooms
        ]  # fmt: skip
        lines += ["", output.table(_ROOMS, rows).rstrip()]
    return [*lines, *(["", *(plan.text for plan in found.plans)] if found.plans else [])]


def _table(figures: Sequence[Figure]) -> list[str]:
    """Figures as a table, and why intervals are not known, each with the figures that have none."""
    rows: list[tuple[object, ...]] = []
    figures_of: dict[str, list[str]] = {}
    for figure in figures:
        estimate, scale = figure.estimate, 100.0 if figure.unit == "%" else 1.0
        digits = 1 if figure.unit == "%" else 2
        alone, combined = (each.scaled(scale) for each in (estimate.real_only, estimate.combined))
        effective = estimate.effective_images
        rows.append((
            f"{figure.name}, {figure.unit}", _text(alone, digits),
            _text(combined, digits) if estimate.simulated else None, _text(estimate.correlation),
            _text(estimate.rate, 1), None if math.isnan(effective) else round(effective),
        ))  # fmt: skip
        every = (alone, combined, estimate.rate, estimate.correlation)
        if reason := next((each.reason for each in every if each.reason), None):
            figures_of.setdefault(reason, []).append(figure.name)
    reasons = [f"{', '.join(names)}: {reason}" for reason, names in figures_of.items()]
    return [*output.table(_NAMES, rows).splitlines(), *reasons]


def _text(interval: Interval, digits: int = 2) -> str | None:
    """`3.87 (3.30 .. 4.54)`, the number alone without an interval, None without a number."""
    if math.isnan(interval.value):
        return None
    number = f"{{:.{digits}f}}".format
    return interval.with_bounds(number) if interval.is_known else number(interval.value)


def _worth(mean: WithSimulation) -> str:
    """What simulation adds to the mean error, as a sentence."""
    rate, correlation = mean.rate, f"correlation of the errors {_text(mean.correlation)}"
    if not rate.is_known:
        return f"what simulation adds is not known: {rate.reason}"
    if rate.value < _LITTLE:
        return f"simulation adds nearly nothing here: {correlation}"
    bounds = rate.bounds_text("{:.1f}".format)
    worth = f"one real image is worth {rate.value:.1f} ({bounds})"
    return f"beside unlimited simulated images, {worth}: {correlation}"


def _decision(found: Evaluation) -> str:
    """Which of two runs has the smaller mean error, as a sentence."""
    mean = found.differences[0].estimate
    by_simulation = mean.simulated and mean.combined.excludes_zero and mean.combined.is_known
    interval = mean.combined if by_simulation else mean.real_only
    if not interval.is_known:
        return f"not decided: {interval.no_bounds}"
    if not interval.excludes_zero:
        return "not decided: the interval of the mean difference holds 0"
    better, worse = (found.other, found.run) if interval.is_positive else (found.run, found.other)
    alone = mean.real_only.excludes_zero
    by = "" if alone else " with the simulated images; not by the real images alone"
    return f"decided: the mean error of {better} is smaller than that of {worse}{by}"

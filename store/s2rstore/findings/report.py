"""All findings about a run, computed from the store."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.findings import costliest_factor
from s2rstore.findings.best_heatmap import best_heatmap
from s2rstore.findings.exchange_rate import exchange_rate
from s2rstore.findings.finding import MIN_INSTANCES, Finding, FindingReport
from s2rstore.findings.gap_drift import gap_drift
from s2rstore.findings.groups import Group
from s2rstore.findings.run_differences import (
    RunErrors,
    best_run,
    largest_regression,
    read_runs,
)
from s2rstore.findings.suggested_change import suggested_change
from s2rstore.findings.worst_group import largest_group, worst_group
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store

ReportShare = Callable[[float], bool]


def largest_room(store: Store, run: str) -> tuple[Group, float, int] | None:
    """The room with the largest median real error, untested; see `largest_group`."""
    return largest_group(store, run, "room", run_metrics.population(store, run))


def find_all(
    store: Store,
    run: str,
    history: Path | None = None,
    report_share: ReportShare = lambda share: True,
) -> FindingReport:
    """Everything that the store shows about a computed run, evident or not.

    All figures are over instances that are new to the run. `history` is a gap history, by default
    that of the store. `report_share` gets the share that is done; where it returns False, the
    report ends there. Raises RequestError where the run is unknown or not computed.
    """
    findings: list[Finding] = []
    missing: list[str] = []
    new = run_metrics.population(store, run)
    runs = read_runs(store, run)
    few = f"fewer than two groups have {MIN_INSTANCES} new instances"
    steps: tuple[tuple[str, Callable[[], Finding | None], str], ...] = (
        ("worst room", lambda: worst_group(store, run, "room", new), _no_rooms(store) or few),
        ("worst heading", lambda: worst_group(store, run, "heading", new), few),
        ("costliest factor", lambda: _costliest_factor(store, run, runs, new),
         "no score, no shares of the gap, no judged translator and no adjusted run"),
        ("best heatmap", lambda: best_heatmap(store, run), "the run has no scored heatmap"),
        ("best run", lambda: best_run(store, runs), _one_run(store)),
        ("largest regression", lambda: largest_regression(store, runs), _one_run(store)),
        ("suggested change", lambda: suggested_change(store, run), ""),
        ("exchange rate", lambda: exchange_rate(store, run), ""),
        ("gap drift", lambda: gap_drift(store, run, history),
         "fewer than two nights of this run were measured"),
    )  # fmt: skip
    for number, (kind, compute, reason) in enumerate(steps):
        if not report_share(number / len(steps)):
            break
        try:
            found = compute()
        except RequestError as error:
            found, reason = None, str(error)
        if found is not None:
            findings.append(found)
        elif reason:
            missing.append(f"{kind}: {reason}")
    if not np.count_nonzero(new):
        missing.insert(0, f"{run} was trained on all its instances, so none is new to it")
    return FindingReport(run, tuple(findings), tuple(missing))


def find_in_selection(store: Store, run: str, selected: NDArray[np.bool_]) -> list[Finding]:
    """The findings about the new instances of a computed run that are `selected` (N,)."""
    new = run_metrics.population(store, run) & selected
    found = [worst_group(store, run, "heading", new), costliest_factor.of_shares(store, run, new)]
    if not _no_rooms(store):
        found.insert(0, worst_group(store, run, "room", new))
    return [finding for finding in found if finding is not None]


def _costliest_factor(
    store: Store, run: str, runs: list[RunErrors], new: NDArray[np.bool_]
) -> Finding | None:
    """By the score of the store, else by shares, else by translators, else by adjusted runs."""
    try:
        report = store.score_report
        if report and report["runs"].get(run) == store.run(run).key:
            scored = costliest_factor.of_score(report["factors"], run)
            if scored is not None:
                return scored
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        message = f"{store.path}: the stored score is invalid"
        raise RequestError(f"{message}; run `s2r score` again") from error
    of_images = costliest_factor.of_shares(store, run, new)
    of_images = of_images or costliest_factor.of_translators(store, run)
    return of_images or costliest_factor.of_adjusted_runs(store, runs)


def _no_rooms(store: Store) -> str:
    return "" if store.instances.room_names else "the data set has no rooms"


def _one_run(store: Store) -> str:
    computed = [run for run in store.runs.values() if run.key]
    few = f"no other run shares {MIN_INSTANCES} new instances"
    return "there is only one run" if len(computed) < 2 else few

"""The costliest factor of the gap, from what a store has measured of its causes.

The score of a synthetic world comes first, then the shares of the gap, then translators, then
adjusted runs of the same model.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.findings.expressions import new_to
from s2rstore.findings.finding import (
    MIN_INSTANCES,
    Finding,
    bounds_text,
    evidence_text,
    sample_text,
)
from s2rstore.findings.run_differences import RunErrors
from s2rstore.intervals import Interval, simultaneous_level
from s2rstore.language.syntax_tree import Compare, Everything, Field
from s2rstore.metrics.gap_shares import SHARED_FACTORS, mean_shares
from s2rstore.reader import Store
from s2rstore.run_inputs import chain_text

KIND = "costliest factor"
_EVIDENT = 0.25
"""Metres of the gap from which a factor counts as harmful for an instance."""
TESTED_TRANSLATORS = 10
"""Translators that the intervals of the metric `error_gain_tested` hold for at once."""
_GAINS = (
    "SELECT translator, value, low, high FROM translator_metric "
    "WHERE metric = 'error_gain_tested' AND reference = 'translator' AND run = ? "
    "AND value IS NOT NULL AND low IS NOT NULL AND high IS NOT NULL ORDER BY value DESC"
)


def of_score(rows: list[dict[str, Any]], run: str) -> Finding | None:
    """Find the factor that increases the real error most on its own, in rows of a score report.

    The intervals of a run's factors hold for all of them at once.
    """
    known = [row for row in rows if row["run"] == run and row["cost"] is not None]
    if not known:
        return None
    worst = max(known, key=lambda row: row["cost"])
    cost, gain = (Interval.from_columns(worst, name) for name in ("cost", "gain"))
    cost = replace(cost, level=simultaneous_level(len(known)))
    evident = cost.is_positive
    figures = f"{cost.value:+.2f} m real error ({bounds_text(cost)}), n {worst['n']}"
    subject = f"{worst['factor']}, alone {figures}"
    return Finding(
        kind=KIND,
        text=subject,
        run=run,
        n=int(worst["n"]),
        evidence=f"{_removal(gain)}; the largest of {len(known)} factors, corrected for their "
        "number",
        evident=evident,
        values={
            "factor": worst["factor"],
            "cost_m": cost.value,
            "gain_without_it_m": gain.value,
            "factors": float(len(known)),
        },
        interval=cost,
        interval_of="cost_m",
        comparisons=len(known),
        n_of="scored instances",
        view="instance",
    )


def _removal(gain: Interval) -> str:
    """What rendering all other factors without this one shows."""
    figures = f"{gain.value:.2f} m ({bounds_text(gain)})"
    if gain.is_positive:
        return f"removing it alone gains {figures}"
    return f"enough on its own; removing it is not shown to help: {figures}"


def of_shares(store: Store, run: str, new: NDArray[np.bool_]) -> Finding | None:
    """The factor with the largest mean share of the gap over the instances `new` (N,)."""
    found = mean_shares(store, run, new)
    if found is None or found.n < MIN_INSTANCES:
        return None
    worst = found.largest
    others = ", ".join(
        f"{share.factor} {share.mean.value:+.2f} m" for share in found.shares if share != worst
    )
    columns = SHARED_FACTORS[worst.factor]
    part = f"{worst.mean.value:.2f} m ({bounds_text(worst.mean)})"
    node = None
    if len(columns) == 1:
        field = Field(f"share.{columns[0]}")
        selected = new & (getattr(store.run_columns(run).real, f"share_{columns[0]}") > _EVIDENT)
        node = Compare(field, ">", _EVIDENT) if selected.any() else None
        count = int(np.count_nonzero(selected))
    return Finding(
        kind=KIND,
        text=f"{part} of the mean gap {found.gap:.2f} m is attributed to {worst.factor}, "
        f"{sample_text(worst.mean, found.n)}",
        run=run,
        n=found.n if node is None else count,
        evidence=f"{others}; estimated by exchanging the factors of both images",
        evident=worst.mean.is_positive,
        values={
            "factor": worst.factor,
            "share_m": worst.mean.value,
            "gap_m": found.gap,
            **{f"share_{'_'.join(s.factor.split())}_m": s.mean.value for s in found.shares},
        },
        interval=worst.mean,
        interval_of="share_m",
        comparisons=len(found.shares),
        n_of="instances" if node is None else f"instances with more than {_EVIDENT} m of it",
        node=node,
        heat=("harm", "position") if worst.factor == "objects" else None,
    )


def of_translators(store: Store, run: str) -> Finding | None:
    """The translator that decreases the real error of a run most."""
    rows = store.execute(_GAINS, [run])
    if not rows:
        return None
    name, *figures = rows[0]
    value, low, high = map(float, figures)
    gain = Interval(low, value, high, simultaneous_level(TESTED_TRANSLATORS))
    evident = gain.is_positive and len(rows) <= TESTED_TRANSLATORS
    subject = f"appearance: translator {name} gains {value:.2f} m ({bounds_text(gain)})"
    return Finding(
        kind=KIND,
        text=subject,
        run=run,
        n=len(rows),
        evidence=f"decrease of the mean real error; the largest of {len(rows)} translators, "
        f"corrected for {TESTED_TRANSLATORS}",
        evident=evident,
        values={"translator": str(name), "gain_m": value},
        interval=gain,
        interval_of="gain_m",
        comparisons=TESTED_TRANSLATORS,
        n_of="translators",
        view="overview",
    )


def of_adjusted_runs(store: Store, runs: list[RunErrors]) -> Finding | None:
    """The adjustment of real images that decreases the real error of the first of `runs` most.

    Compared are runs of the same model on the same domains that differ in the real side's
    adjustments alone.
    """
    present, *others = runs
    own = store.run(present.run)
    found = []
    for other in others:
        record = store.run(other.run)
        rows = store.in_recording_order(present.new & other.new)
        if (
            record.model is not None
            and (record.model, record.sim_domain, record.real_domain, record.sim_adjustments)
            == (own.model, own.sim_domain, own.real_domain, own.sim_adjustments)
            and not own.real_adjustments
            and record.real_adjustments
            and rows.size >= MIN_INSTANCES
        ):
            gain = float((present.real[rows] - other.real[rows]).mean())
            found.append((gain, other, rows))
    if not found:
        return None
    _, other, rows = max(found, key=lambda candidate: candidate[0])
    gain_interval = intervals.paired_difference(
        present.real[rows] - other.real[rows],
        store.instances.trajectory[rows],
        level=simultaneous_level(len(found)),
    )
    evident = gain_interval.is_positive
    chain = chain_text(store.run(other.run).real_adjustments)
    bounds = bounds_text(gain_interval)
    subject = f"{chain} (run {other.run}) gains {gain_interval.value:.2f} m ({bounds})"
    return Finding(
        kind=KIND,
        text=f"{subject}, n {rows.size} new to both",
        run=present.run,
        n=int(rows.size),
        evidence="decrease of the mean real error by adjusting real images "
        f"({evidence_text(gain_interval, len(found), 'adjusted runs')})",
        evident=evident,
        values={"adjustment": chain, "gain_m": gain_interval.value},
        interval=gain_interval,
        interval_of="gain_m",
        comparisons=len(found),
        node=new_to(Everything(), present.new, {other.run: other.new}),
        view="compare",
        other=other.run,
    )

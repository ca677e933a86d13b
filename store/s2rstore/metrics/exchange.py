"""Exchange rates of runs: what their simulated images add to real ones, before and after a change.

The change is that of a tuned or edited simulator or of a translator: a run whose images were
changed is compared with the run of the same model on unchanged images.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.intervals import LEVEL
from s2rstore.intervals.simulation import WithSimulation
from s2rstore.metrics.evaluation import images_of, mean_error
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rstore.run_inputs import chain_text

Members = NDArray[np.bool_]


def mean_errors(store: Store, members: Members | None = None) -> Mapping[str, WithSimulation]:
    """The mean error of each computed run, real images alone and with simulation.

    Runs to which no member is new are left out; `members` (N,) as in `images_of`.
    """
    found = {}
    for run in [each.run for each in store.runs.values() if each.key]:
        try:
            found[run] = mean_error(store, run, images_of(store, [run], members))
        except RequestError:
            continue
    return found


@dataclass(frozen=True, slots=True)
class ExchangeChange:
    """The mean error of `run` and, on the same images, that of its `baseline` before the change.

    changes: the domain and the adjustments of the run that the baseline lacks. Without a baseline,
    `before` is None and nothing was changed.
    """

    run: str
    after: WithSimulation
    baseline: str | None = None
    before: WithSimulation | None = None
    changes: str = ""

    @property
    def is_evident(self) -> bool:
        """Whether the intervals of both exchange rates are known and do not overlap."""
        if self.before is None or not (self.before.rate.is_known and self.after.rate.is_known):
            return False
        one, two = self.before.rate, self.after.rate
        return one.high < two.low or two.high < one.low

    @property
    def text(self) -> str:
        """`one real image is worth 1.8 (1.5 .. 2.3), 1.1 (1.0 .. 1.2) before camera_fov=4`."""
        rates = [each.rate for each in (self.after, self.before) if each is not None]
        shown = [
            rate.with_bounds("{:.1f}".format) if rate.is_known else f"- ({rate.reason})"
            for rate in rates
        ]
        before = f", {shown[1]} before {self.changes}" if self.before is not None else ""
        return f"one real image is worth {shown[0]}{before}"

    def as_json(self) -> dict[str, Any]:
        """The exchange rates as JSON data."""
        return {
            "run": self.run, "baseline": self.baseline, "changes": self.changes,
            "pairs": self.after.n, "after": self.after.rate.as_json(),
            "before": None if self.before is None else self.before.rate.as_json(),
            "evident": self.is_evident, "text": self.text,
        }  # fmt: skip


def exchange_change(
    store: Store, run: str, members: Members | None = None, level: float = LEVEL
) -> ExchangeChange:
    """The exchange rate of a computed run, and that before its images were changed.

    Raises RequestError where no pair is new to the run, or to both runs.
    """
    base = _baseline(store, store.run(run))
    if base is None:
        images = images_of(store, [run], members)
        return ExchangeChange(run, mean_error(store, run, images, level))
    images = images_of(store, [base.run, run], members)
    before, after = (mean_error(store, name, images, level) for name in (base.run, run))
    return ExchangeChange(run, after, base.run, before, _changes(store.run(run), base))


def changed_runs(store: Store, run: str) -> list[str]:
    """The run itself if its images were changed; else the computed runs whose baseline it is."""
    if _baseline(store, store.run(run)) is not None:
        return [run]
    bases = {name: _baseline(store, record) for name, record in store.runs.items() if record.key}
    return [name for name, base in bases.items() if base is not None and base.run == run]


def _baseline(store: Store, run: Run) -> Run | None:
    """The computed run of the same model and real domain without adjustments.

    Of several, it is that on the sim domain which came first into the store, and the oldest of
    these. None for that run itself, for imported predictions, and where there is none.
    """

    def added_at(each: Run) -> str:
        facts = store.provenance_object("dataset", f"domain:{each.sim_domain}")
        return str(facts.get("added_at", ""))

    unchanged = [
        each for each in store.runs.values()
        if each.key and (each.model, each.real_domain) == (run.model, run.real_domain)
        and not (each.sim_adjustments or each.real_adjustments)
    ]  # fmt: skip
    base = min(unchanged, key=added_at, default=None)
    return base if run.model is not None and base is not None and base.run != run.run else None


def _changes(run: Run, base: Run) -> str:
    domain = "" if run.sim_domain == base.sim_domain else f"domain {run.sim_domain}"
    chains = map(chain_text, (run.sim_adjustments, run.real_adjustments))
    return "; ".join(filter(None, (domain, *chains))) or "no change"

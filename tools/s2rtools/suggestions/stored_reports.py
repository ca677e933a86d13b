"""Store a report in the provenance of a store, and register its answers as runs."""

from __future__ import annotations

from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.suggestions import SuggestReport, section
from s2rtools.precompute.run_registration import add_run


def save_report(root: Path, report: SuggestReport) -> None:
    """Publish a report in the store, in place of an earlier one of the same run and side."""
    with edit(root) as draft:
        draft.set_provenance(section(report.run), {report.side: report.as_json()})


def apply_answer(root: Path, report: SuggestReport, number: int, name: str | None) -> str:
    """Register answer `number`, counted from 1, as a run; return the run's name.

    Raises RequestError for a number that the report does not have, and as `add_run` does.
    """
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

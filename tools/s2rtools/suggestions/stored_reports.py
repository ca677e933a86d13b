"""The reports of a store: written to its provenance, read, and applied as runs."""

from __future__ import annotations

from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtools.precompute.run_registration import add_run
from s2rtools.suggestions.answers import SuggestReport, from_json


def section(run: str) -> str:
    """The section of the provenance that holds the reports of a run, by side."""
    return f"suggestion:{run}"


def save_report(root: Path, report: SuggestReport) -> None:
    """Publish a report in the store, in place of an earlier one of the same run and side."""
    with edit(root) as draft:
        draft.set_provenance(section(report.run), {report.side: report.as_json()})


def read_report(store: Store, run: str, side: Side) -> SuggestReport | None:
    """The stored report of a run; None where there is none, or the run was computed anew since.

    Raises RequestError where the stored report is invalid.
    """
    record = store.run(run)
    data = store.provenance_object(section(record.run), side)
    if not data:
        return None
    try:
        report = from_json(data)
    except (KeyError, TypeError, ValueError) as error:
        raise RequestError(
            f"{store.path}: the stored suggestion for run {record.run} is invalid; "
            "run `s2r suggest` again"
        ) from error
    return report if report.key == record.key else None


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

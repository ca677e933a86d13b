"""The result of a search that a store keeps for a side of a run."""

from __future__ import annotations

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rstore.suggestions.report import SuggestReport, from_json


def section(run: str) -> str:
    """The section of the provenance that holds the reports of a run, by side."""
    return f"suggestion:{run}"


def read_report(store: Store, run: str, side: Side) -> SuggestReport | None:
    """The stored report of a run; None where there is none, or the run was computed anew since.

    Raises RequestError where the stored report is invalid.
    """
    record = store.run(run)
    data = store.provenance_object(section(record.run), side)
    if not data or data.get("key") != record.key:
        return None
    try:
        return from_json(data)
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise RequestError(
            f"{store.path}: the stored suggestion for run {record.run} is invalid; "
            "run `s2r suggest` again"
        ) from error

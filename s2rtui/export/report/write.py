"""A report from a store to a file."""

from __future__ import annotations

from pathlib import Path

from s2rtui.export.report.collect import gather
from s2rtui.export.report.html_page import page
from s2rtui.export.report.request import ReportRequest, Told
from s2rtui.session import Session
from s2rtui.user_data.notebook import ReadNotebook


def report(
    store: Path, request: ReportRequest, told: Told = lambda done, total, what: None
) -> bytes:
    """The HTML of a report: the same store, notebook and request give the same bytes.

    Raises RequestError for what does not exist.
    """
    session = Session(store, None, ReadNotebook)
    try:
        return session_report(session, request, told)
    finally:
        session.close()


def session_report(session: Session, request: ReportRequest, told: Told) -> bytes:
    """The HTML of a report on a session's open store, whose state it changes; see `report`."""
    return page(gather(session, request, told)).encode()

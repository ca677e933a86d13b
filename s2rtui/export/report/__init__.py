"""Report of selections: one self-contained HTML file for a browser or a printer."""

from s2rtui.export.report.build_report import render_report
from s2rtui.export.report.report_request import (
    ReportRequest,
    RequestedSelection,
    saved,
    selections,
)

__all__ = ["ReportRequest", "RequestedSelection", "render_report", "saved", "selections"]

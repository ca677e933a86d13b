"""A report of selections: one HTML file that stands alone, for a browser, a printer, a reader."""

from s2rtui.export.report.request import ReportRequest, RequestedSelection, saved, selections
from s2rtui.export.report.write import report

__all__ = ["ReportRequest", "RequestedSelection", "report", "saved", "selections"]

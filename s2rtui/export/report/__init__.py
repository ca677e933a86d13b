"""A report of selections: one HTML file that stands alone, for a browser, a printer, a reader."""

from s2rtui.export.report.request import Asked, Request, saved, selections
from s2rtui.export.report.write import report

__all__ = ["Asked", "Request", "report", "saved", "selections"]

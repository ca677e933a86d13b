"""Findings: what a store shows about its runs, each with its evidence and its selection."""

from s2rstore.findings.finding import Finding, FindingReport
from s2rstore.findings.report import find_all, largest_room

__all__ = ["Finding", "FindingReport", "find_all", "largest_room"]

"""Results of `s2r suggest`: their data, and those that a store keeps for its runs."""

from s2rstore.suggestions.report import (
    AIMS,
    Agreement,
    Answer,
    Change,
    FactorGain,
    SuggestReport,
    bounds_text,
    from_json,
)
from s2rstore.suggestions.stored import read_report, section

__all__ = [
    "AIMS",
    "Agreement",
    "Answer",
    "Change",
    "FactorGain",
    "SuggestReport",
    "bounds_text",
    "from_json",
    "read_report",
    "section",
]

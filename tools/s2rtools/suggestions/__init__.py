"""Suggested changes of real images or of the simulator: search, judgement on held-out data, report.

`suggest` is the entry point; `s2r suggest` prints what it returns.
"""

from s2rtools.suggestions.settings import SuggestSettings
from s2rtools.suggestions.suggest import suggest

__all__ = ["SuggestSettings", "suggest"]

"""Line on standard error about a run that is not computed for all instances."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from s2rstore.reader import Store


def print_coverage(store: Store, runs: Iterable[str | None]) -> None:
    """Print a line for each run that is computed for some of the instances only."""
    for run in dict.fromkeys(runs):
        if run and (note := store.coverage(run).note):
            print(note, file=sys.stderr)

"""What a gate takes where nothing is said, and what it allows; imports nothing."""

from __future__ import annotations

THRESHOLD = 15.0
"""Of G."""
MARGIN = 0.05
"""Metres by which the mean real error may have grown since the golden run, as an upper bound."""
SEED, MOST_SEED = 1, 2**31 - 1
REPLICATES, FEWEST_REPLICATES, MOST_REPLICATES = 1000, 100, 100_000
"""Of every bootstrap."""
ODOMETRY = "odometry"
"""In place of a folder of drives: the data set's own, against its ground truth."""

"""Defaults and limits of the options of `s2r gap`; imports nothing, to keep `--help` fast."""

from __future__ import annotations

THRESHOLD = 15.0
"""Largest G that passes."""
MARGIN = 0.05
"""Metres by which the mean real error may grow since the golden run, as an upper bound."""
SEED, MAX_SEED = 1, 2**31 - 1
ODOMETRY = "odometry"
"""Value of `--drives` for the odometry of the data set, compared with its ground truth."""

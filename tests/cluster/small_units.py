"""`python -m tests.cluster.small_units ARGS` is `s2r ARGS` with units of four instances.

So a run of a small store has many units.
"""

import sys

from s2rtools.precompute.tasks import network_outputs
from s2rtui.cli import main

UNIT_ROWS = 4

if __name__ == "__main__":
    network_outputs.FORWARD_ROWS = UNIT_ROWS
    sys.exit(main())

"""The application on a pseudo-terminal."""

import os
import sys
from pathlib import Path

from bench.support.screen import Screen


def open_application(
    store: Path, share: Path, *options: str, size: tuple[int, int] = (120, 40), draws: bool = True,
    **variables: str,
) -> Screen:  # fmt: skip
    """Start `s2r tui` with options and variables; the user's data lies in `share`."""
    environment = {
        "XDG_DATA_HOME": str(share), "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        "COLORTERM": "truecolor", "OMP_NUM_THREADS": "1",
    }  # fmt: skip
    command = [sys.executable, "-m", "s2rtui", "tui", *options, str(store)]
    return Screen(command, size, environment | variables, draws=draws)

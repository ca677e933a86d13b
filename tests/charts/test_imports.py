"""Importing the charts loads neither matplotlib nor Pillow nor torch."""

from __future__ import annotations

import subprocess
import sys


def test_importing_charts_loads_no_heavy_package() -> None:
    code = (
        "import sys, s2rtui.canvas, s2rtui.charts.registry, s2rtui.charts.map.paper; "
        "print([name for name in ('matplotlib', 'PIL', 'torch', 'cv2') if name in sys.modules])"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert process.stdout.strip() == "[]"

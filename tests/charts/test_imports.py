"""Plots are light: they load neither matplotlib nor Pillow, and never torch."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["s2rtui.canvas", "s2rtui.charts.registry"])
def test_cold_import_stays_light(module: str) -> None:
    code = (
        f"import sys, {module}; "
        "print([name for name in ('matplotlib', 'PIL', 'torch', 'cv2') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_figures_load_matplotlib_only_when_drawn() -> None:
    code = "import sys, s2rtui.charts.map.paper; print('matplotlib' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"

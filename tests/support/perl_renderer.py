"""A renderer program in Perl, and the frames that it writes."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

_PROGRAM = Path(__file__).parent / "perl_renderer.pl"


def perl_command():
    """The command of the renderer without its mode; skips where Perl or a module lacks."""
    path = shutil.which("perl")
    modules = ["-MJSON::PP", "-MCompress::Zlib"]
    if path is None or subprocess.run([path, *modules, "-e", "1"], stderr=-3).returncode:
        pytest.skip("no Perl with JSON::PP and Compress::Zlib")
    return [path, str(_PROGRAM)]


def rgb_of(height: int, width: int, lamp: float = 1.0):
    """The image that the Perl renderer writes."""
    rows, columns = np.mgrid[:height, :width]
    blue = np.full((height, width), int(255 * lamp / 2))
    return np.stack([columns % 256, rows % 256, blue], axis=2).astype(np.uint8)


def depth_of(height: int, width: int, x: float):
    """The depth in metres that the Perl renderer writes at x of a pose."""
    return abs(x) + np.arange(height * width).reshape(height, width) / 16

"""The default world is the same on every processor: its routes do not depend on the last digits."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest

from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe

ROUTES = "a946e67528e412cc"
_PRINT = """
import hashlib
import numpy as np
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
data = WorldData(WorldRecipe(seed=1, count=24, frame=48))
content = b"".join(np.ascontiguousarray(data.poses[name]).tobytes() for name in sorted(data.poses))
poses = np.concatenate([data.poses[name] for name in sorted(data.poses)])[::6]
for side in ("sim", "real"):
    views = data.views(side, poses, np.arange(len(poses)))
    content += views.rgb.tobytes() + data.raw_depth(views).tobytes()
print(hashlib.sha256(content).hexdigest())
"""


def test_the_routes_are_those_of_the_documentation():
    data = WorldData(WorldRecipe(seed=1, count=24, frame=48))
    poses = np.concatenate([data.poses[name] for name in sorted(data.poses)])
    assert poses.shape == (48, 3)
    assert hashlib.sha256(np.round(poses, 3).tobytes()).hexdigest()[:16] == ROUTES


@pytest.mark.deep
def test_routes_and_images_do_not_depend_on_the_instructions_of_the_processor():
    """numpy without its AVX-512 and AVX2 functions, numba for a generic processor."""
    plain = {
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL",
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
    }
    printed = {
        subprocess.run(
            [sys.executable, "-W", "ignore", "-c", _PRINT],
            env={**os.environ, **more}, capture_output=True, text=True, check=True,
        ).stdout
        for more in ({}, plain)
    }  # fmt: skip
    assert len(printed) == 1

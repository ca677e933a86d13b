"""`python -m s2rtools.precompute.compile_ahead`: compile functions into numba's cache.

These are functions of UMAP and of the comparison of light. It takes 15 s once; `s2r demo` lets
another process do it while it renders the images.
"""

import numpy as np

from s2rtools.counterfactual.relighting import relight
from s2rtools.precompute.tasks.umap_projection import SETTINGS, joint_umap

_ROWS = 64

if __name__ == "__main__":
    rng = np.random.default_rng(0)
    points = rng.random((2, _ROWS, SETTINGS.components), dtype=np.float32)
    joint_umap((points[0], points[1]), np.ones(_ROWS, dtype=np.bool_))
    images = rng.random((2, 8, 8, 3), dtype=np.float32)
    depth, weight = rng.random((2, 8, 8), dtype=np.float32)
    light = relight(images[0], images[1], depth, weight)
    light.removed(images[1])

"""`python -m s2rtools.precompute.compile_ahead`: compile UMAP into numba's cache.

It takes half a minute once; `s2r demo` lets another process do it while it renders the images.
"""

import numpy as np

from s2rtools.precompute.tasks.umap_projection import SETTINGS, joint_umap

_ROWS = 64

if __name__ == "__main__":
    points = np.random.default_rng(0).random((2, _ROWS, SETTINGS.components), dtype=np.float32)
    joint_umap((points[0], points[1]), np.ones(_ROWS, dtype=np.bool_))

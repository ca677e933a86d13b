"""The renderer of ten lines in the documentation renders what it states."""

import re
import sys
from pathlib import Path

import numpy as np

import s2rstore
from s2rtools.datasets.layouts import read

_PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "your-simulator.md"


def test_the_example_renders_a_floor(s2r, tiny_store, tmp_path):
    (code,) = re.findall(r"^```python\n(.*?)^```", _PAGE.read_text(), re.MULTILINE | re.DOTALL)
    program, out = tmp_path / "my_sim.py", tmp_path / "out"
    program.write_text(f"import module_beside_it\n{code}")
    (tmp_path / "module_beside_it.py").touch()
    command = f"{sys.executable} {program}"
    s2r("render", tiny_store, "--renderer", command, "--random", "2", "--set", "light=0.5",
        "--out", out, "--frames-only").checked()  # fmt: skip
    frame, _ = read("csv", out / "frames.csv").trajectories["random-0"].frames
    with s2rstore.open(tiny_store) as store:
        domain, height = store.domain("sim"), store.dataset.frame_height
    lens = domain.rgb
    rows = (np.arange(height) + 0.5 - lens.cy) / lens.fy
    slope = -np.cos(lens.pitch) * rows + np.sin(lens.pitch)
    metres = np.where(slope < 0, domain.camera_height / np.maximum(-slope, 1e-9), 0)
    metres[metres > domain.depth_raw_max * domain.depth_scale] = 0
    depth = frame.depth.read().pixels[:, height // 2] * domain.depth_scale
    np.testing.assert_allclose(depth, metres, atol=0.51 * domain.depth_scale)
    np.testing.assert_array_equal(frame.rgb.read().pixels[slope < 0], 45)

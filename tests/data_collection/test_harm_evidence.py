"""The harm of new real images: which rows, side and plane are read."""

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.data_collection import expected_reduction
from tests.support import embeddings, tiny

N = 40
PLANES = ("position", "heading", "loss")


def maps(side: str) -> np.ndarray:
    """Harm (N, 3, 2, 2): per pixel -9, iid, 0 and iid in the plane `position` of real images."""
    rows = np.full((N, 3, 2, 2), 100.0 if side == "real" else 1000.0, dtype=np.float32)
    if side == "real":
        iids = np.arange(N)
        rows[:, 0] = np.stack([np.full(N, -9), iids, 0 * iids, iids], axis=-1).reshape(N, 2, 2)
    return rows


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tiny.build(tmp_path_factory.mktemp("harm") / "s.s2r", n=N, runs=("vanilla",))
    sides = {side: maps(side) for side in ("sim", "real")}
    embeddings.add(path, "vanilla", sides, "harm", ("output", "row", "column"), 16)
    return path


def test_harm_sums_the_positive_positions_of_the_new_real_images(store, monkeypatch):
    monkeypatch.setattr(expected_reduction, "_HARM_ROWS", 8)
    new = np.array([3, 6, 33])
    read: list[int] = []
    with s2rstore.open(store) as opened:
        heatmaps = opened.heatmaps

        def counted(run, kind, side, start, stop, mode=None):
            read.extend(range(start, stop))
            return heatmaps(run, kind, side, start, stop, mode)

        monkeypatch.setattr(type(opened), "heatmaps", lambda _, *words: counted(*words))
        np.testing.assert_array_equal(expected_reduction._harm(opened, "vanilla", new), 2.0 * new)
    assert set(new) <= set(read)
    assert not set(range(8, 32)) & set(read)


def test_an_unknown_mode_names_the_planes_of_the_kind(store):
    with s2rstore.open(store) as opened:
        with pytest.raises(RequestError, match=r"harm has no mode 'x' \(modes: position, heading"):
            opened.heatmaps("vanilla", "harm", "real", 0, 1, "x")
        with pytest.raises(RequestError, match=r"'position' \(modes: x, y, heading, loss\)"):
            opened.heatmaps("vanilla", "activation", "real", 0, 1, "position")
        for plane, mode in enumerate(PLANES):
            found = opened.heatmaps("vanilla", "harm", "real", 5, 7, mode)
            np.testing.assert_array_equal(found, maps("real")[5:7, plane])

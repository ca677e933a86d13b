"""Views of pairs whose sim image has a pose of its own, from which its errors are measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rtui.canvas import DARK
from s2rtui.charts.instance.model import instance_input
from s2rtui.charts.map.model import error_glyphs, full_scale
from s2rtui.charts.map.terminal import draw_map, map_layout
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.scene import Resources, Scene
from s2rtui.charts.shared.base_map_model import MapInput, map_input, map_model
from s2rtui.charts.shared.image_pair_model import instance_model
from s2rtui.charts.shared.image_pair_terminal import draw_instance
from s2rtui.session import Session
from tests.charts.test_error_glyphs import many_points
from tests.support import tiny
from tests.support.copies import copy_store

SIZE = (80, 26)
RUN = "vanilla"


@pytest.fixture(scope="module")
def loose(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store whose sim images have the poses that a run predicts for them."""
    folder = tmp_path_factory.mktemp("loose")
    path = tiny.build(folder / "s.s2r")
    with s2rstore.open(path) as store:
        sim = store.run_columns(RUN).sim
        rows: dict[str, np.ndarray | list[str]] = {
            "iid": np.arange(len(sim.x)),
            "domain": ["sim"] * len(sim.x),
            "x": sim.x.copy(),
            "y": sim.y.copy(),
            "heading": sim.heading.copy(),
        }
    with edit(path) as draft:
        draft.insert("frame_pose", rows)
    return path


def test_map_glyphs_measure_each_side_from_the_pose_of_its_image(loose: Path) -> None:
    session = Session(loose)
    session.select("all")
    view = replace(map_input(session.store, session.state), mode="glyph")
    model, layout = map_model(view), map_layout(view, SIZE)
    for footprint in ((7, 3), (1, 1)):
        glyphs = error_glyphs(view, model, layout.frame, footprint)
        np.testing.assert_allclose(glyphs.sim, 0, atol=1e-12)
        assert np.hypot(*glyphs.real.T).max() > 0.1
    real = np.hypot(*(view.real - view.truth).T)
    errors = np.concatenate([np.zeros(len(real)), real])
    assert full_scale(view) == pytest.approx(np.percentile(errors, 99))


def test_blocks_of_many_instances_measure_each_side_from_the_pose_of_its_image() -> None:
    view = many_points(2000)
    moved = replace(
        view,
        sim_truth=view.sim - np.array([0.5, 0.0]),
        real_truth=view.real - np.array([0.0, 0.25]),
    )
    blocks = error_glyphs(moved, map_model(moved), map_layout(moved, SIZE).frame, (7, 3))
    assert blocks.crowded
    np.testing.assert_allclose(blocks.sim, np.tile([0.5, 0.0], (len(blocks.sim), 1)), atol=1e-9)
    np.testing.assert_allclose(blocks.real, np.tile([0.0, 0.25], (len(blocks.real), 1)), atol=1e-9)


def test_map_lines_begin_at_the_pose_of_the_image(loose: Path) -> None:
    """A sim prediction at the pose of its image has no line, so no cell has the colour of one."""
    session = Session(loose)
    session.select("ids(4)")
    own = replace(map_input(session.store, session.state), mode="full", cursor=None)

    def braille_cells(view: MapInput) -> int:
        canvas = draw_map(view, SIZE)
        is_line = (canvas.fg == np.array(DARK.sim)).all(axis=-1)
        glyphs = np.vectorize(lambda text: "\u2801" <= text <= "\u28ff")(canvas.char)
        return int(np.count_nonzero(is_line & glyphs))

    far = replace(own, sim=own.sim + np.array([0.0, 3.0]), real=np.full_like(own.real, np.nan))
    assert braille_cells(far) > 0
    assert braille_cells(replace(far, sim=own.sim)) <= 1
    at_truth = replace(far, sim_truth=far.sim)
    assert braille_cells(at_truth) <= 1


def test_the_instance_shows_the_true_pose_of_each_side(loose: Path) -> None:
    with s2rstore.open(loose) as store:
        shown = instance_input(store, RUN, 5, None)
        for side in ("sim", "real"):
            pose = dict(shown.truths)[f"{side} truth"]
            assert pose == pytest.approx(store.poses(side)[5])
        lines = instance_model(shown).poses
        assert [line.label for line in lines] == ["sim truth", "real truth", "sim", "real"]
        assert lines[0].cells[:3] == lines[2].cells[:3]
        text = "\n".join(draw_instance(shown, (60, 50)).lines())
        assert "sim truth" in text
        assert "real truth" in text


def test_the_instance_of_a_common_pose_shows_one_truth(tiny_store: Path) -> None:
    with s2rstore.open(tiny_store) as store:
        shown = instance_input(store, RUN, 5, None)
        assert [label for label, _ in shown.truths] == ["truth"]


def test_tables_and_subtitles_name_the_poses_of_the_images(loose: Path, tiny_store: Path) -> None:
    for path, is_loose in ((loose, True), (tiny_store, False)):
        session = Session(path)
        scene = Scene(session.store, session.state, Resources())
        names, rows = BY_NAME["map"].numbers(scene)
        assert ("sim_true_x_m" in names) == is_loose
        assert "real_true_x_m" not in names
        assert {len(row) for row in rows} == {len(names)}
        subtitle = BY_NAME["orientation"].subtitle(scene)
        assert ("sim images have true headings" in subtitle) == is_loose


def test_each_rank_has_the_number_of_predictions_of_its_side(
    tiny_store: Path, tmp_path: Path
) -> None:
    path = copy_store(tiny_store, tmp_path / "s.s2r")
    with edit(path) as draft:
        for iid in ("3", "4"):
            draft.delete("prediction", run=RUN, side="sim", iid=iid)
    with s2rstore.open(path) as store:
        columns, count = store.run_columns(RUN), len(store.instances)
        ranks = dict(instance_input(store, RUN, 5, None).notes)["ranks"]
        sim, real = columns.sim.rank[5], columns.real.rank[5]
        assert ranks == f"sim {sim} of {count - 2}, real {real} of {count} by error"
        ranks = dict(instance_input(store, RUN, 4, None).notes)["ranks"]
        assert ranks.startswith(f"sim none of {count - 2}, real ")

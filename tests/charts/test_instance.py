"""The instance view: image panels, heat, numbers, and pairs whose sim image has its own pose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.records import SIDES
from s2rtui.canvas import DARK, DEFAULT_OPTIONS
from s2rtui.charts.map import VIEW as MAP
from s2rtui.charts.map import MapInput
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.scene import LoadedData, Scene
from s2rtui.charts.shared.instance import image_heat_scale, instance_drawing, pose_rows
from s2rtui.charts.shared.instance_input import instance_input as stored_instance_input
from s2rtui.drawing.cells import draw_cells
from s2rtui.session.session import Session
from tests.charts.examples import draw_map, instance_input, side
from tests.charts.test_error_glyphs import many_points
from tests.charts.test_error_glyphs import shown as shown_arcs
from tests.support import tiny


def cells(data, size=(60, 50), options=DEFAULT_OPTIONS):
    return draw_cells(instance_drawing(data), size, options)


def pose_texts(data):
    return [[cell.text for cell in row.cells] for row in pose_rows(data)]


def test_signed_scale_is_symmetric_and_shared_and_unsigned_starts_at_zero():
    scale = image_heat_scale(instance_input())
    assert scale is not None
    low, high = scale
    assert low == -high
    both = np.concatenate([side(1).heat.ravel(), side(2).heat.ravel()])  # type: ignore[union-attr]
    assert high == pytest.approx(np.abs(both).max())
    unsigned = image_heat_scale(instance_input(signed=False, sim=side(1, heat=False)))
    assert unsigned is not None
    assert unsigned[0] <= 0


@pytest.mark.parametrize(
    ("over", "rows"), [("rgb", ["image"]), ("depth", ["depth"]), ("both", ["image", "depth"])]
)
def test_heat_lies_on_the_images_that_it_is_computed_of(over, rows):
    plots = instance_drawing(instance_input(over=over)).plots
    assert [plot.y.names[0] for plot in plots if plot.image.overlay] == [
        row for row in rows for _ in SIDES
    ]


def test_negative_zero_nan_and_missing_depth_have_texts():
    (_, *pose), *_ = pose_texts(instance_input(truth=(-0.001, float("nan"), 0.0)))
    assert pose[:3] == ["0.00", "n/a", "0.0"]
    without = cells(instance_input(real=side(2, depth=False)))
    assert "no depth" in "".join(without.lines())


def test_a_translated_side_shows_the_original_below():
    real = side(2)
    translated = replace(real, original=255 - real.rgb)
    drawing = instance_drawing(instance_input(real=translated))
    rows = [plot.y.names[0] for plot in drawing.plots]
    assert rows == ["image", "image", "original", "original", "depth", "depth"]
    text = "\n".join(draw_cells(drawing, (60, 60)).lines())
    assert text.count("original") == 1
    assert "not translated" in text
    original = drawing.plots[3].image
    assert original.overlay is None
    assert (original.ground == 255 - real.rgb).all()


MAP_SIZE = (80, 26)
RUN = "vanilla"


@pytest.fixture(scope="module")
def loose(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store whose sim images have the poses that a run predicts for them."""
    path = tiny.build(tmp_path_factory.mktemp("loose") / "s.s2r")
    with s2rstore.open(path) as store:
        sim = store.run_columns(RUN).sim
        rows = {name: getattr(sim, name).copy() for name in ("x", "y", "heading")}
        rows |= {"iid": np.arange(sim.x.size), "domain": ["sim"] * sim.x.size}
    with edit(path) as draft:
        draft.insert("frame_pose", rows)
    return path


def map_of(session: Session) -> MapInput:
    return MAP.input(Scene(session.store, session.state, LoadedData()))


def test_blocks_of_many_instances_measure_each_side_from_the_pose_of_its_image():
    view = many_points(2000)
    (sim_x, sim_y), (real_x, real_y) = view.sim, view.real
    moved = replace(view, sim_truth=(sim_x - 0.5, sim_y), real_truth=(real_x, real_y - 0.25))
    _, blocks = shown_arcs(moved)
    assert blocks.is_crowded
    np.testing.assert_allclose(blocks.sim, np.tile([0.5, 0.0], (len(blocks.sim), 1)), atol=1e-9)
    np.testing.assert_allclose(blocks.real, np.tile([0.0, 0.25], (len(blocks.real), 1)), atol=1e-9)


def test_map_lines_begin_at_the_pose_of_the_image(loose):
    """A sim prediction at the pose of its image has no line, so no cell has the colour of one."""
    session = Session(loose)
    session.select("ids(4)")
    own = replace(map_of(session), mode="full", cursor=None)

    def braille_cells(view: MapInput) -> int:
        canvas = draw_map(view, MAP_SIZE)
        is_line = (canvas.fg == np.array(DARK.sim)).all(axis=-1)
        glyphs = np.vectorize(lambda text: "\u2801" <= text <= "\u28ff")(canvas.char)
        return int(np.count_nonzero(is_line & glyphs))

    (x, y), nowhere = own.sim, np.full_like(own.real[0], np.nan)
    far = replace(own, sim=(x, y + 3.0), real=(nowhere, nowhere))
    assert braille_cells(far) > 0
    assert braille_cells(replace(far, sim=own.sim)) <= 1
    at_truth = replace(far, sim_truth=far.sim)
    assert braille_cells(at_truth) <= 1


def test_the_instance_shows_the_true_poses_of_its_images(loose, tiny_store):
    with s2rstore.open(loose) as store:
        shown = stored_instance_input(store, RUN, 5, None)
        for side in ("sim", "real"):
            pose = dict(shown.truths)[f"{side} truth"]
            assert pose == pytest.approx(store.poses(side)[5])
        lines = pose_texts(shown)
        assert [line[0] for line in lines] == ["sim truth", "real truth", "sim", "real"]
        assert lines[0][1:4] == lines[2][1:4]
        text = "\n".join(cells(shown).lines())
        assert "sim truth" in text
        assert "real truth" in text
    with s2rstore.open(tiny_store) as store:
        shown = stored_instance_input(store, RUN, 5, None)
        assert [label for label, _ in shown.truths] == ["truth"]


def test_tables_and_subtitles_name_the_poses_of_the_images(loose, tiny_store):
    for path, is_loose in ((loose, True), (tiny_store, False)):
        session = Session(path)
        scene = Scene(session.store, session.state, LoadedData())
        names, rows = BY_NAME["map"].numbers(scene)
        assert ("sim_true_x_m" in names) == is_loose
        assert "real_true_x_m" not in names
        assert {len(row) for row in rows} == {len(names)}
        subtitle = BY_NAME["orientation"].subtitle(scene)
        assert ("sim images have true headings" in subtitle) == is_loose


def test_each_rank_has_the_number_of_predictions_of_its_side(store_copy):
    with edit(store_copy) as draft:
        for iid in ("3", "4"):
            draft.delete("prediction", run=RUN, side="sim", iid=iid)
    with s2rstore.open(store_copy) as store:
        columns, count = store.run_columns(RUN), len(store.instances)
        five, four = (
            dict(stored_instance_input(store, RUN, iid, None).notes)["ranks"] for iid in (5, 4)
        )
        sim, real = columns.sim.rank[5], columns.real.rank[5]
    assert five == f"sim {sim} of {count - 2}, real {real} of {count} by error"
    assert four.startswith(f"sim none of {count - 2}, real ")


def test_on_a_wide_screen_the_numbers_stand_beside_larger_images():
    rows = cells(instance_input(), (120, 37)).lines()
    head = next(row for row in rows if "err m" in row)
    assert "sim" in head[:40]  # the title of an image begins the same line
    assert not any("err m" in row[:70] for row in rows)

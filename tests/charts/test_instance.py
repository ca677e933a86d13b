"""The instance view: image panels, heat, numbers, and pairs whose sim image has its own pose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.colour import NO_DEPTH
from s2rtui.charts.instance import paper as instance_paper
from s2rtui.charts.instance.model import instance_input as stored_instance_input
from s2rtui.charts.map import VIEW as MAP
from s2rtui.charts.map import MapInput
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.scene import LoadedData, Scene
from s2rtui.charts.shared import image_pair_terminal
from s2rtui.charts.shared.image_pair_model import instance_model, panel_pixels
from s2rtui.charts.shared.image_pair_terminal import draw_instance, instance_layout
from s2rtui.drawing.heat_colours import heat_colours
from s2rtui.session import Session
from tests.charts.examples import draw_map, instance_input, points_of, side
from tests.charts.test_error_glyphs import many_points
from tests.charts.test_error_glyphs import shown as shown_arcs
from tests.support import tiny


def test_sim_and_real_panels_have_the_same_size_side_by_side():
    panels = instance_layout(instance_input(), (60, 50)).panels
    for what in ("rgb", "depth"):
        sim, real = (panel for panel in panels if panel.what == what)
        assert (sim.side, real.side) == ("sim", "real")
        assert sim.x + sim.width <= real.x
        assert (sim.y, sim.width, sim.height) == (real.y, real.width, real.height)


@pytest.mark.parametrize("size", [(36, 38), (60, 50), (80, 22), (150, 30)])
def test_panels_fit_and_keep_the_aspect_ratio(size):
    layout = instance_layout(instance_input(), size)
    assert layout.panels
    for panel in layout.panels:
        assert panel.x + panel.width <= size[0]
        assert panel.y + panel.height <= size[1]
        assert panel.width == pytest.approx(2 * panel.height, abs=2)


def test_signed_scale_is_symmetric_and_shared_and_unsigned_starts_at_zero():
    model = instance_model(instance_input())
    assert model.heat_range is not None
    low, high = model.heat_range
    assert low == -high
    both = np.concatenate([side(1).heat.ravel(), side(2).heat.ravel()])  # type: ignore[union-attr]
    assert high == pytest.approx(np.abs(both).max())
    unsigned = instance_model(instance_input(signed=False, sim=side(1, heat=False)))
    assert unsigned.heat_range is not None
    assert unsigned.heat_range[0] <= 0


@pytest.mark.parametrize(
    ("module", "bar", "colours", "draw"),
    [(instance_paper, "draw_colour_bar", 6, instance_paper.instance_figure),
     (image_pair_terminal, "colour_bar", 5, image_pair_terminal.draw_instance)],
)  # fmt: skip
def test_the_bar_of_signed_heat_is_neutral_in_the_middle(module, bar, colours, draw, monkeypatch):
    drawn, ramps = getattr(module, bar), []

    def record(*arguments):
        ramps.append(arguments[colours])
        return drawn(*arguments)

    monkeypatch.setattr(module, bar, record)
    draw(instance_input(), (600, 400))
    assert np.ptp(ramps[0]([0.5])) == 0
    assert np.ptp(ramps[0]([0.9])) > 80


def test_zero_heat_is_transparent():
    _, opacity = heat_colours(np.array([[0.0, 1.0, np.nan]]), (-1.0, 1.0), signed=True)
    assert opacity[0, [0, 2]].tolist() == [0, 0]
    assert opacity[0, 1] > 0.7


def test_invalid_depth_has_a_separate_colour():
    view = instance_input()
    pixels = panel_pixels(view.sim, "depth", instance_model(view), view, (32, 32))
    assert (pixels[:4] == NO_DEPTH).all()
    assert not (pixels[4:] == NO_DEPTH).all(axis=-1).any()


def test_numbers_are_metres_and_degrees():
    text = "\n".join(draw_instance(instance_input(), (60, 50)).lines())
    for number in ("1.50", "-2.25", "28.6", "0.75", "5.7", "22.9"):
        assert number in text
    assert "occlusion rgb" in text
    assert "#12" in text
    assert "größer" in text


def test_negative_zero_nan_and_missing_depth_have_texts():
    model = instance_model(instance_input(truth=(-0.001, float("nan"), 0.0)))
    assert model.poses[0].cells[:3] == ("0.00", "n/a", "0.0")
    without = draw_instance(instance_input(real=side(2, depth=False)), (60, 50))
    assert "no depth" in "".join(without.lines())


@pytest.mark.parametrize(
    "options", [RenderOptions(ascii=True), RenderOptions(mode=ColourMode.NONE)]
)
def test_heat_is_drawn_as_digits_and_letters_without_colours(options):
    view = instance_input()
    layout = instance_layout(view, (60, 60), options)
    heat = [panel for panel in layout.panels if panel.what == "heat"]
    assert len(heat) == 2
    canvas = draw_instance(view, (60, 60), options)
    panel = heat[0]
    part = canvas.char[panel.y : panel.y + panel.height, panel.x : panel.x + panel.width]
    assert set(part.ravel()) <= set("ihgfedcba.123456789")


def test_a_translated_side_shows_the_original_below():
    real = side(2)
    translated = replace(real, original=255 - real.rgb)
    data = instance_input(real=translated)
    kinds = [panel.what for panel in instance_layout(data, (60, 60)).panels]
    assert kinds == ["rgb", "rgb", "original", "original", "depth", "depth"]
    text = "\n".join(draw_instance(data, (60, 60)).lines())
    assert text.count("original") == 1
    assert "not translated" in text
    model, shape = instance_model(data), real.rgb.shape[:2]
    drawn = panel_pixels(translated, "original", model, data, (shape[0], shape[1]))
    assert (drawn == 255 - real.rgb).all()


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


def test_map_glyphs_measure_each_side_from_the_pose_of_its_image(loose):
    session = Session(loose)
    session.select("all")
    view = replace(map_of(session), mode="glyph")
    for footprint in ((7, 3), (1, 1)):
        arcs, glyphs = shown_arcs(view, footprint)
        np.testing.assert_allclose(glyphs.sim, 0, atol=1e-12)
        assert np.hypot(*glyphs.real.T).max() > 0.1
    real = np.hypot(*(points_of(view, "real") - points_of(view)).T)
    errors = np.concatenate([np.zeros(len(real)), real])
    assert arcs.full == pytest.approx(np.percentile(errors, 99))


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
        lines = instance_model(shown).poses
        assert [line.label for line in lines] == ["sim truth", "real truth", "sim", "real"]
        assert lines[0].cells[:3] == lines[2].cells[:3]
        text = "\n".join(draw_instance(shown, (60, 50)).lines())
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

"""The suggestions view: answers of both directions, their gains, values and commands."""

from dataclasses import replace
from pathlib import Path

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.suggestions import section
from s2rtui.canvas import DARK, RenderOptions
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.suggestions import SuggestionsInput, answer_of_row, suggestions_drawing
from s2rtui.cli import main
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.export.load_scene import SceneOptions, open_scene
from tests.support.suggestions import store_reports, suggest_report, suggestions_input


def text_of(data: SuggestionsInput, size: tuple[int, int], **options: bool) -> str:
    lines = draw_cells(suggestions_drawing(data), size, RenderOptions(**options)).lines()
    return " ".join(" ".join(lines).split())


@pytest.mark.parametrize("size", [(80, 40), (120, 40)])
def test_directions_answers_gains_and_values_are_shown(size):
    text = text_of(suggestions_input(), size)
    for part in (
        "real images adapt the real images", "simulator tune the simulator",
        "50 held-out instances", "price of each change 2 % (0.04 m)",
        "?1 1 change +0.100 m (-0.040 .. +0.200)",
        "*3 3 changes +0.300 m (+0.250 .. +0.400)", "brightness=0.85, vignette=0.37 (exposure)",
        "*3 3 changes +30.0 % (+25.0 .. +40.0)", "(camera, lights, depth)",
    ):  # fmt: skip
        assert part in text


def test_details_of_an_answer_hold_intervals_truth_and_the_command():
    text = text_of(suggestions_input(chosen="sim 1"), (120, 40))
    assert "camera_height=-0.07 (-0.072 .. -0.068), true -0.09" in text
    assert "sim error 0.54 -> 2.84 m" in text
    assert "answer 1: enter copies the command" in text
    assert "s2r run add height --adjust sim:camera_height=-0.07" in text
    assert "enter adjusts the real images live" in text_of(suggestions_input(), (120, 40))


def test_gains_lie_on_one_axis_with_zero_and_price():
    canvas = draw_cells(suggestions_drawing(suggestions_input(sim=0)), (120, 40))
    rows = [line for line in canvas.lines() if "change" in line and "│" in line]
    assert len(rows) == 3
    zeros = {line.index("│") for line in rows}
    assert len(zeros) == 1
    marks = [line.index("○" if "?" in line else "●") for line in rows]
    assert marks == sorted(marks)
    assert marks[0] > zeros.pop()
    prices = [line.index("┊") for line in rows]
    assert prices == sorted(prices)
    assert prices[2] < marks[2]


def test_nothing_helps_and_missing_results_are_said():
    report = suggest_report("real", helps=False)
    data = suggestions_input(sim=0)
    direction = data.directions[0]
    changed = SuggestionsInput((replace(direction, report=report), data.directions[1]))
    text = text_of(changed, (120, 40))
    assert "nothing helps: no change that gains its price helps" in text
    assert "*" not in text.replace("* suggested", "")
    assert "no stored result; `s2r suggest s.s2r --for sim` computes one" in text


def test_a_click_finds_the_answer_of_a_line():
    data = suggestions_input()
    drawing = suggestions_drawing(data)
    (panel,) = drawing_panels(drawing, (120, 40))
    lines = draw_cells(drawing, (120, 40)).lines()
    rows = [y for y, line in enumerate(lines) if "*3  3 changes" in line]
    places = [answer_of_row(data, int(panel.to_data(3.5, row + 0.5)[1])) for row in (*rows, 0)]
    assert places == [2, 5, None]


@pytest.fixture
def store(store_copy: Path) -> Path:
    store_reports(store_copy, "vanilla", "real", "sim")
    return store_copy


def test_show_prints_the_answers_of_the_run(store, capsys):
    assert main(["show", str(store), "suggestions", "--run", "vanilla", "--format", "csv"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 7
    assert lines[3].startswith('real,3,3,"brightness=0.85, vignette=0.37, depth_blur=1.2"')
    assert lines[3].endswith("yes,yes")
    assert main(["show", str(store), "suggestions", "--run", "dataaug", "--words"]) == 0
    words = capsys.readouterr().out
    assert f"s2r suggest {store} --run dataaug --for sim" in words


def test_results_of_an_earlier_computation_and_invalid_ones_are_not_shown(store):
    with edit(store) as draft:
        broken = {**suggest_report("sim").as_json(), "answers": [], "best": 2}
        with s2rstore.open(store) as opened:
            broken["key"] = opened.run("vanilla").key
        draft.set_provenance(section("vanilla"), {"sim": broken})
        draft.set_provenance(section("dataaug"), {"real": suggest_report(key="old").as_json()})
    view = BY_NAME["suggestions"]
    with open_scene(store, SceneOptions(run="vanilla"), view) as scene:
        real, sim = view.input(scene).directions
        assert real.report is not None
        assert sim.report is None
        assert "is invalid" in sim.note
    with (
        open_scene(store, SceneOptions(run="dataaug"), view) as scene,
        pytest.raises(RequestError, match="no stored result"),
    ):
        view.figure(scene, (400, 300), DARK)


def test_texts_of_a_store_hold_no_control_characters(store):
    report = suggest_report("real").as_json()
    report["answers"][0]["changes"][0]["adjustment"] = "bright\x1b[31mness"
    with edit(store) as draft:
        with s2rstore.open(store) as opened:
            report["key"] = opened.run("vanilla").key
        draft.set_provenance(section("vanilla"), {"real": report})
    view = BY_NAME["suggestions"]
    with open_scene(store, SceneOptions(run="vanilla"), view) as scene:
        assert "\x1b" not in view.input(scene).directions[0].answers[0].changes_text

"""`s2r collect`, its CSV file, and the map layer of planned poses."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.files.planned_poses import COLUMNS, PlannedPose, as_rows, read_planned_poses
from s2rtools.common.command_line.row_formats import csv_text
from s2rtools.data_collection import command

_NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)
_TEXT = st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "Zs")), max_size=20)


@given(st.lists(st.builds(PlannedPose, _NUMBERS, _NUMBERS, _NUMBERS, _TEXT, _NUMBERS, _TEXT)))
def test_csv_round_trip(tmp_path_factory, poses):
    path = tmp_path_factory.mktemp("poses") / "poses.csv"
    path.write_text(csv_text(COLUMNS, as_rows(poses)), encoding="utf-8")
    assert read_planned_poses(path) == tuple(poses)


def test_only_the_pose_is_required(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("# mine\nheading_deg,y_m,x_m,who\n90,2,1,me\n")
    (pose,) = read_planned_poses(path)
    assert (pose.x_m, pose.y_m, pose.heading_deg, pose.room) == (1, 2, 90, "")
    assert math.isnan(pose.expected_gain_m)


@pytest.mark.parametrize(
    ("text", "message"),
    [("x_m,y_m\n1,2\n", "no column heading_deg"), ("x_m,y_m,heading_deg\n1,two,3\n", "pose 1: y_m"),
     ("x_m,y_m,heading_deg\n1,nan,3\n", "not a finite number"), ("", "no column x_m"),
     *((f"x_m,y_m,heading_deg\n{row}\n", "beyond 1,000,000")
       for row in ("1e7,2,3", "1,-1e9,3", "1,2,1e300"))],
)  # fmt: skip
def test_wrong_files_are_refused(tmp_path, text, message):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(RequestError, match=message):
        read_planned_poses(path)


def test_the_command_writes_prints_and_saves(tiny_store, tmp_path, s2r):
    out = tmp_path / "poses.csv"
    arguments = ["collect", str(tiny_store), "--run", "vanilla", "--budget", "12"]
    printed = s2r(*arguments, "--out", out, "--save", "todo").printed
    assert "12 poses (combined)" in printed
    assert "nearest instances: ids(" in printed
    assert len(read_planned_poses(out)) == 12
    captured = s2r(*arguments, "--json").checked()
    assert "choosing 12 of" in captured.err
    content = json.loads(captured.out)
    assert [pose["x_m"] for pose in content["poses"]] == [p.x_m for p in read_planned_poses(out)]
    by_name, by_ids = (
        s2r("query", tiny_store, expression, "--run", "vanilla", "--count").printed
        for expression in ("@todo", content["expression"])
    )
    assert by_name == by_ids


def test_methods_of_the_command_are_those_of_the_tools():
    from s2rtools.data_collection.expected_reduction import METHODS

    assert tuple(METHODS) == command.METHODS


@pytest.mark.parametrize(
    ("options", "message"),
    [(["--run", "no"], "no"), (["--save", " "], "name"),
     (["--set", "lamp=1"], "--set: only with --renderer"),
     (["--out", "nowhere/poses.csv"], "--out nowhere/poses.csv: there is no folder")],
)  # fmt: skip
def test_messages(tiny_store, s2r, options, message):
    s2r("collect", tiny_store, *options).assert_refused(message)


def test_the_map_alone_shows_planned_poses(tiny_store, tmp_path, s2r):
    poses = tmp_path / "poses.csv"
    poses.write_text("x_m,y_m,heading_deg\n2,3,0\n7,5,90\n")
    screen = tmp_path / "screen.txt"
    for options, is_marked in ((), False), (("--poses", poses), True):
        s2r("snapshot", tiny_store, "--size", "160x48", "--out", screen, *options).checked()
        assert ("2 planned" in screen.read_text()) == is_marked
    figure = tmp_path / "f.svg"
    words = ["export", tiny_store, "--poses", poses, "--out", figure, "--view"]
    s2r(*words, "rooms").assert_refused("drawn on the map; use --view map in place of rooms")
    s2r(*words, "map").checked()
    assert "planned poses" in figure.read_text()

"""Depth images tell whether headings, handedness, depth scale and order are as declared."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.geometry import angles
from s2rstore.index import schema
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import check as verified
from s2rtools.datasets.appending.append import append
from s2rtools.datasets.conventions.convention_check import (
    CONVENTIONS,
    DECLARED,
    Convention,
    ConventionCheck,
    check_conventions,
)
from s2rtools.datasets.conventions.convention_report import PICTURE, _moving, doubts
from s2rtools.datasets.conventions.depth_frames import DepthFrames, DepthPoints, Order
from s2rtools.datasets.importers import IMPORTERS, synthetic_world
from s2rtools.datasets.scan import Scan, ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
from tests.support.copies import copy_store

COUNT, CHECKED = 120, 50
"""Instances of the trajectory, and those of them that are checked: neighbours see the same."""
FRAME = 64


def world_scan(**fields: object) -> Scan:
    """The first trajectory of a world, without a floor plan."""
    options = ScanOptions(("traj1",), frame=(FRAME, FRAME), world={"seed": 3, **fields})
    scan = synthetic_world.scan(Path(), options)
    scan.floor_plan, scan.drives = None, None
    return scan


@cache
def frames(side: str) -> DepthFrames:
    data = WorldData(WorldRecipe(seed=3, count=COUNT, frame=FRAME))
    poses = data.poses["traj1"][:CHECKED]
    views = data.views(side, poses, np.arange(len(poses)))  # type: ignore[arg-type]
    domain = world_scan(count=COUNT).domains[side]
    return DepthFrames.of(domain, data.raw_depth(views), np.asarray(poses, np.float64), True)


def wrongly_declared(source: DepthFrames, error: Convention) -> DepthFrames:
    """The same frames with conventions that are wrong by `error`."""
    poses = source.poses.copy()
    poses[:, 2] = angles.wrap(error.sign * poses[:, 2] + error.quarters * np.pi / 2)
    domain = replace(source.domain, depth_scale=source.domain.depth_scale * error.scale)
    y_down = source.y_down != error.flipped
    return replace(source, domain=domain, poses=poses, y_down=y_down)


def undone(error: Convention) -> Convention:
    """The convention that corrects an error."""
    quarters = -error.sign * error.quarters % 4
    return Convention(error.sign, quarters, error.flipped, round(1 / error.scale, 6))


@pytest.mark.parametrize("side", ["sim", "real"])
def test_right_conventions_are_the_sharpest(side):
    check = check_conventions(frames(side))
    assert check.verdict == "as declared"
    assert check.lead > check.margin + 0.05
    assert min(check.sharpness, key=lambda c: check.sharpness[c].entropy) in (
        DECLARED, Convention(scale=0.1), Convention(scale=0.2), Convention(scale=0.5),
    )  # fmt: skip


@pytest.mark.parametrize(
    "error",
    [
        error if number % 4 == 0 else pytest.param(error, marks=pytest.mark.deep)
        for number, error in enumerate(CONVENTIONS[1:])
    ],
    ids=str,
)
def test_wrong_conventions_are_named(error):
    check = check_conventions(wrongly_declared(frames("sim"), error))
    assert check.verdict == "doubtful"
    assert check.best_other == undone(error)


def test_conventions_are_distinct_and_have_their_own_names():
    points = DepthPoints(frames("sim"))
    places = [np.stack(each.on_floor(points))[:, :50].round(6).tobytes() for each in CONVENTIONS]
    assert len(set(places)) == len(CONVENTIONS)
    assert len({str(convention) for convention in CONVENTIONS}) == len(CONVENTIONS)
    assert Convention(scale=5.0).finding == "depth looks 5 times too small"
    assert Convention(scale=0.5).finding == "depth looks 2 times too large"
    assert Convention(-1, 1, True).finding == "x and y look swapped"


def test_few_frames_decide_nothing():
    source = frames("sim")
    few = replace(source, raw=source.raw[:12], poses=source.poses[:12])
    check = check_conventions(wrongly_declared(few, Convention(quarters=1)))
    assert check.verdict == "not decided"
    assert check.text == f"sim not decided (12 frames, {check.points} points)"


def test_small_differences_decide_nothing():
    found = check_conventions(frames("sim"))
    even = dict.fromkeys(found.sharpness, found.sharpness[DECLARED])
    assert ConventionCheck("sim", COUNT, 9999, even).verdict == "not decided"


def test_doubts_name_the_sharper_convention():
    checks = [check_conventions(frames("sim")), check_conventions(frames("real"))]
    assert doubts(checks) == []
    wrong = wrongly_declared(frames("real"), Convention(sign=-1))
    (issue,) = doubts([checks[0], check_conventions(wrong)])
    assert (issue.kind, issue.file) == ("convention doubtful", "real")
    assert issue.detail.startswith("headings look counted in the other direction; images and poses")
    assert "agree best with heading negated (" in issue.detail


@pytest.fixture(scope="module")
def ingested(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A store of the start of a trajectory without a floor plan, and what ingest reported."""
    path, lines = tmp_path_factory.mktemp("ingested") / "a.s2r", list[str]()
    scan = world_scan(count=COUNT)
    scan.trajectories["traj1"] = list(scan.trajectories["traj1"])[:CHECKED]
    build(scan, path, "test", True, lambda count: None, lines.append)
    return path, lines


def doubts_of(scan: Scan, order: Order, count: int, folder: Path) -> dict[str, str]:
    """What ingest doubts by domain where the images of a trajectory have poses in another order."""
    ((name, records),) = scan.trajectories.items()
    first = list(records)[:count]
    others = [first[order.row(row, count)] for row in range(count)]
    scan.trajectories[name] = [
        replace(record, x=other.x, y=other.y, heading=other.heading)
        for record, other in zip(first, others, strict=True)
    ]
    build(scan, folder / "a.s2r", "test", False, lambda count: None)
    return {i.file: i.detail for i in scan.issues if i.kind == "convention doubtful"}


@pytest.mark.parametrize(
    ("error", "finding", "remedy"),
    [
        (Order(1), "numbering of poses looks shifted by 1", "the pose 1 row before that of the"),
        (Order(-4), "numbering of poses looks shifted by 4", "the pose 4 rows behind that of the"),
        (Order(is_reversed=True), "poses look listed in reverse order", "poses in reverse order"),
    ],
    ids=["next row", "earlier row", "reversed"],
)
def test_ingest_names_poses_of_other_rows(tmp_path, error, finding, remedy):
    found = doubts_of(world_scan(count=COUNT), error, CHECKED, tmp_path)
    assert set(found) == {"sim", "real"}
    for detail in found.values():
        assert detail.startswith(f"{finding}; images and poses of ")
        assert f"agree best with {remedy}" in detail


@pytest.mark.real
@pytest.mark.parametrize(
    ("error", "finding"),
    [(DECLARED.order, None), (Order(-2), "numbering of poses looks shifted by 2;"),
     (Order(is_reversed=True), "poses look listed in reverse order;")],
    ids=["right", "earlier row", "reversed"],
)  # fmt: skip
def test_poses_of_other_rows_are_named_in_the_real_data(real_data, tmp_path, error, finding):
    scan = IMPORTERS["sim2realviz"](real_data, ScanOptions(frame=(FRAME, FRAME)))
    found = doubts_of(scan, error, 60, tmp_path)
    assert set(found) == (set(scan.domains) if finding else set())
    assert all(detail.startswith(str(finding)) for detail in found.values())


def test_ingest_draws_and_reports_the_check(ingested):
    path, lines = ingested
    assert len(lines) == 1
    assert lines[0].endswith(f"; picture {path / PICTURE}")
    assert lines[0].startswith("headings, handedness and depth scale: sim as declared (")
    with s2rstore.open(path) as store:
        assert PICTURE in store.checksums
        facts = {
            key: json.loads(text) for key, text in store.provenance(schema.CONVENTIONS).items()
        }
        assert json.loads(store.provenance("floor_plan")["frames"]) == CHECKED
    assert facts["real"]["verdict"] == "as declared"
    assert facts["real"]["picture"] == PICTURE
    assert set(facts["sim"]["conventions"]) == set(map(str, CONVENTIONS))
    picture = cv2.imread(str(path / PICTURE))
    assert picture.shape[1] == 2 * 480


def test_drawn_floor_plan_shows_the_walls_of_the_world(ingested):
    drawn = cv2.imread(str(ingested[0] / "assets/floor_plan.png"), cv2.IMREAD_GRAYSCALE)
    options = ScanOptions(("traj1",), frame=(FRAME, FRAME), world={"seed": 3, "count": COUNT})
    plan = synthetic_world.scan(Path(), options).floor_plan
    assert isinstance(plan, np.ndarray)
    grey = cv2.cvtColor(plan, cv2.COLOR_RGB2GRAY)
    truth = cv2.resize(grey, drawn.shape[::-1], interpolation=cv2.INTER_AREA)
    dark = drawn < 120
    assert dark.any()
    assert truth[dark].mean() < truth[dark[:, ::-1]].mean() - 10


def test_an_append_checks_its_instances_before_it_publishes_them(tmp_path):
    path, scan, first = tmp_path / "a.s2r", world_scan(count=COUNT), 2
    records = list(scan.trajectories["traj1"])[: CHECKED + first]
    scan.trajectories["traj1"] = records[:first]
    build(scan, path, "test", True, lambda count: None)
    negated = [replace(record, heading=-record.heading) for record in records[first:]]
    scan.trajectories["traj1"] = records[:first] + negated
    before = layout.read_current(path)
    with pytest.raises(RequestError, match=r"convention doubtful: .* with heading negated"):
        append(scan, path, "test", True, lambda count: None)
    assert layout.read_current(path) == before
    scan.issues.clear()
    lines: list[str] = []
    append(scan, path, "test", False, lambda count: None, lines.append)
    assert lines[-1].startswith(
        "headings, handedness and depth scale: real doubtful: headings look "
    )
    assert {issue.kind for issue in scan.issues} == {"convention doubtful"}
    notes = [note for note in verified(path).notes if "sharper" in note]
    assert len(notes) == len(scan.issues)
    assert all(f", instances from iid {first} on: " in note for note in notes)


def test_verify_notes_doubtful_conventions(ingested, tmp_path):
    store = copy_store(ingested[0], tmp_path / "copy.s2r")
    assert verified(store).notes == ()
    with edit(store) as draft:
        facts = {"verdict": "doubtful", "picture": PICTURE}
        draft.set_provenance(schema.CONVENTIONS, {"real": facts})
    (note,) = verified(store).notes
    assert note.startswith("domain real: depth is sharper")
    assert note.endswith(PICTURE)


def test_frames_ten_centimetres_apart_are_compared_despite_rounding():
    poses = [(0.1 * number, 0.0, 0.0) for number in range(40)]
    turns = [(0.0, 0.0, np.radians(5 * number)) for number in range(40)]
    for each in (poses, turns):
        assert len(_moving(each, lambda pose: pose)) == 40

"""Runs on loose pairs, and on images without depth."""

import math
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import torch
from torch import Tensor, nn

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.geometry.floor_grid import FloorHeat
from s2rstore.geometry.map_grid import MapGrid
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.maintenance.verify import verify
from s2rstore.records import SIDES
from s2rtools.datasets.floor.floor_poses import FloorOptions
from s2rtools.datasets.pairing.paired_recordings import PairOptions, scan_pairs
from s2rtools.datasets.pairing.recorded_scan import MapOptions
from s2rtools.datasets.writing.build import build
from s2rtools.interactive.live_model import LiveModel
from s2rtools.models import build_network
from s2rtools.models.conventions import OutputConvention
from s2rtools.models.model_registration import add_model, pack_weights, register_model
from s2rtools.precompute.array_keys import ArrayKeys
from s2rtools.precompute.input_hashes import InputHashes
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import add_run
from s2rtools.training.train_into_store import TrainingRequest, train_into_store
from s2rtui.cli import main
from s2rtui.session.heatmaps import selection_grid
from s2rtui.session.state import HeatChoice
from tests.conftest import BuildOnce
from tests.support import recordings
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

N = 12
KINDS = ("activation", "pixel_difference")
CHAINS: dict[str, list[dict[str, object]]] = {"sim": [], "real": []}


def make_store(folder: Path, has_depth: bool) -> Path:
    """A store of pairs whose sim images are 0.3 m beside the real ones and turned by 6 degrees."""
    truth = recordings.walk(N)
    beside = np.column_stack([-np.sin(truth[:, 2]), np.cos(truth[:, 2])])
    sim = truth + np.column_stack([0.3 * beside, np.full(N, np.radians(6))])
    paths = [
        recordings.write(folder / name, recordings.side(poses), has_depth=has_depth, seed=seed)
        for seed, (name, poses) in enumerate((("sim", sim), ("real", truth)))
    ]
    read = [recordings.LAYOUT.read(path, recordings.ReadOptions()) for path in paths]
    floors = {side: FloorOptions(ground=0.0) for side in SIDES}
    options = PairOptions("name", None, MapOptions((64, 64)), floors=floors)
    made = scan_pairs(*read, options)
    build(made.scan, folder / "s.s2r", "s2r ingest", False, lambda steps: None)
    return folder / "s.s2r"


@pytest.fixture
def without_depth(build_once: BuildOnce, tmp_path: Path) -> Path:
    """A store of loose pairs without depth and without a run."""

    def build_pairs(path: Path) -> None:
        with TemporaryDirectory() as folder:
            copy_store(make_store(Path(folder), has_depth=False), path)

    return copy_store(build_once("loose-rgb.s2r", build_pairs), tmp_path / "s.s2r")


@pytest.fixture(scope="module")
def loose(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A store of loose pairs with a computed run, and what the computation said."""
    path = make_store(tmp_path_factory.mktemp("loose"), has_depth=True)
    torch.manual_seed(0)
    network = build_network("resposenet")
    with edit(path) as draft:
        register_model(path, draft, "m", pack_weights(network), OutputConvention("cos_sin"))
    add_run(path, "r", "m", None, None, CHAINS)
    reporter = SilentReporter()
    precompute(path, reporter, [], PrecomputeOptions(KINDS, backend="torch"))
    return path, reporter.lines


def test_the_error_of_a_side_is_the_distance_to_the_pose_of_its_own_image(loose):
    with s2rstore.open(loose[0]) as store:
        columns = store.run_columns("r")
        for side in SIDES:
            truth, part = store.poses(side), columns.side(side)
            distance = np.hypot(part.x - truth[:, 0], part.y - truth[:, 1])
            np.testing.assert_allclose(part.error, distance, atol=1e-9)
            turn = np.abs(np.angle(np.exp(1j * (part.heading - truth[:, 2]))))
            np.testing.assert_allclose(part.heading_error, turn, atol=1e-9)
        apart = np.hypot(*(store.poses("sim") - store.poses("real"))[:, :2].T)
        np.testing.assert_allclose(apart, 0.3, atol=1e-9)
    assert verify(loose[0]) == []


def test_the_language_the_tables_and_the_views_know_the_offset(loose, s2r):
    path = str(loose[0])
    with s2rstore.open(path) as store:
        for text, count in (
            ("pair_offset_m > 0.29", N),
            ("pair_offset_m > 0.31", 0),
            ("pair_offset_deg: 5.9..6.1", N),
            ("worst(3, pair_offset_m)", 3),
        ):
            query, parameters = evaluation.sql(store, text)
            assert np.count_nonzero(evaluation.select(store, text)) == count
            assert len(store.execute(query, parameters)) == count
    header, row = (
        line.split(",") for line in s2r("query", path, "ids(4)", "--format", "csv").lines
    )
    assert float(row[header.index("pair_offset_m")]) == pytest.approx(0.3)
    assert float(row[header.index("pair_offset_deg")]) == pytest.approx(6)
    assert (
        "sim pose 0.30 m, 6.0 degrees from the real one"
        in s2r("show", path, "instance", "--iid", "4", "--format", "csv").printed
    )


def test_heat_lies_on_the_map_where_the_side_was(loose):
    """A stored grid equals that of the instances, projected from the poses of the side's images."""
    with s2rstore.open(loose[0]) as store:
        for side in SIDES:
            heat = HeatChoice("activation", "loss", side)
            stored = np.nan_to_num(store.map_grid("r", "activation", side, "loss"))
            shown = np.nan_to_num(selection_grid(store, "r", heat, np.arange(N), "mean"))
            np.testing.assert_allclose(stored, shown, atol=1e-6)
            other = store.domain("real" if side == "sim" else "sim")
            projector = FloorHeat(store.domain(side), other, store.dataset, side, None, None, "rgb")
            grid = MapGrid(store.dataset.bounds)
            depth = store.frames(side, 0, N, ("depth",))["depth"]
            samples = projector.samples(depth, None, store.poses(side), grid)
            values = store.heatmaps("r", "activation", side, 0, N, "loss")
            grid.add(*samples.values(values, "rgb"))
            expected = np.nan_to_num(np.asarray(grid.aggregates()[0]))
            assert np.count_nonzero(expected)
            np.testing.assert_allclose(stored, expected, atol=1e-6)


def test_live_predictions_have_the_stored_errors(loose):
    with s2rstore.open(loose[0]) as store:
        live = LiveModel(store, "r")
        try:
            result = live.compute(3, {})
            assert result is not None
            for side in SIDES:
                stored = store.run_columns("r").side(side).error[3]
                assert result.side(side).error == pytest.approx(stored, abs=1e-3)
        finally:
            live.close()


def test_the_computation_says_that_images_of_two_poses_are_compared(loose):
    (line,) = [line for line in loose[1] if "apart in the median" in line]
    assert "0.30 m and 6.0 degrees" in line
    assert "pixel_difference compares them" in line


def test_keys_change_with_the_poses_of_the_frames(loose, tmp_path):
    def keys(path: Path) -> tuple[str, str]:
        with s2rstore.open(path) as store:
            made = ArrayKeys(InputHashes(store), store.run("r"), store.parts[0].iids)
            backend = {"name": "torch", "precision": "float32"}
            return made.heatmap("activation", backend, [])[0], made.prediction(backend, [])

    path = copy_store(loose[0], tmp_path / "s.s2r")
    before = keys(path)
    with edit(path) as draft:
        draft.update("frame_pose", {"domain": "sim"}, {"x": 1.0})
    after = keys(path)
    assert before[0] != after[0]
    assert before[1] == after[1]
    with edit(path) as draft:
        draft.delete("frame_pose")
    with s2rstore.open(path) as store:
        assert not store.has_own_poses("sim")
        np.testing.assert_array_equal(store.poses("sim")[:, 0], store.instances.x)


def test_imported_predictions_are_measured_against_the_poses_of_their_own_images(
    without_depth, tmp_path
):
    path = without_depth
    with s2rstore.open(path) as store:
        rows = [
            f"{iid},{side},{x!r},{y!r},{math.degrees(heading)!r}"
            for side in SIDES
            for iid, (x, y, heading) in enumerate(store.poses(side).tolist())
        ]
    file = tmp_path / "poses.csv"
    file.write_text("\n".join(["iid,side,x,y,heading", *rows]))
    assert main(["run", "import", "p", "--predictions", str(file), "--store", str(path)]) == 0
    precompute(path, SilentReporter(), [], PrecomputeOptions(("pixel_difference",)))
    with s2rstore.open(path) as store:
        columns = store.run_columns("p")
        for side in SIDES:
            assert columns.side(side).error.max() < 1e-9
            assert columns.side(side).heading_error.max() < 1e-9
        np.testing.assert_allclose(columns.shift, 0.3, atol=1e-9)
        assert {r.mode for r in store.array_kinds("p") if r.kind == "pixel_difference"} == {"rgb"}
    assert verify(path) == []


def test_damage_of_poses_and_offsets_is_found(loose, tmp_path):
    for name, table, where, values, words in (
        ("a", "frame_pose", {"domain": "sim"}, {"x": 1.0}, "error is not the distance"),
        ("b", "frame_pose", {"domain": "real"}, {"y": None}, "pose is NULL"),
        ("c", "instance", {"trajectory": "walk"}, {"pair_offset_m": -1.0}, "pair offset"),
        ("d", "frame_pose", {"domain": "real"}, {"domain": "other"}, "without a row in domain"),
    ):
        path = copy_store(loose[0], tmp_path / name)
        with edit(path) as draft:
            draft.update(table, where, values)
        assert any(words in damage.what for damage in verify(path))


class RgbNetwork(nn.Module):
    """Predicts a pose from the mean colours."""

    def __init__(self) -> None:
        super().__init__()
        self.out = nn.Linear(3, 4)

    def forward(self, x: Tensor) -> Tensor:
        return self.out(x.mean(dim=(2, 3)))


def test_without_depth_an_rgb_model_runs_and_what_needs_depth_says_so(without_depth, tmp_path, s2r):
    path = without_depth
    torch.manual_seed(0)
    with edit(path) as draft:
        weights = pack_weights(build_network("resposenet"))
        register_model(path, draft, "depth", weights, OutputConvention("cos_sin"))
    with pytest.raises(RequestError, match="domain sim has no depth; model depth needs it"):
        add_run(path, "d", "depth", None, None, CHAINS)
    with pytest.raises(RequestError, match="has no depth; architecture resposenet needs it"):
        train_into_store(path, TrainingRequest("vanilla", steps=1), lambda *steps: None, "train")
    file, table = tmp_path / "rgb.pt", tmp_path / "rgb.toml"
    torch.jit.script(RgbNetwork()).save(str(file))
    table.write_text('channels = "rgb"\nsize = [16, 16]\n')
    add_model(path, "rgb", file, "torchscript", "cos_sin", True, table)
    add_run(path, "r", "rgb", None, None, CHAINS)
    reporter = SilentReporter()
    precompute(path, reporter, [], PrecomputeOptions(None, backend="torch", trust=True))
    (line,) = [line for line in reporter.lines if "no depth in" in line]
    assert "sim and real" in line
    assert "harmonised_distance" in line
    with s2rstore.open(path) as store:
        records = store.array_kinds("r")
        assert not [record for record in records if record.kind.startswith("map:")]
        assert not [record for record in records if record.mode in ("depth", "rgbd")]
        assert {r.mode for r in records if r.kind == "pixel_difference"} == {"rgb"}
        heat = HeatChoice("pixel_difference", "rgb", "real")
        with pytest.raises(RequestError, match="domain real has no depth; heat on the map"):
            selection_grid(store, "r", heat, np.arange(3), "mean")
    assert verify(path) == []
    export = ["export", str(path), "--view", "map", "--out", str(tmp_path / "m.png")]
    s2r(*export, "--heat", "pixel_difference:rgb").assert_refused("has no depth; heat on the map")
    out = str(tmp_path / "w.png")
    assert main(["show", str(path), "instance", "--iid", "2"]) == 0
    assert main(["export", str(path), "--view", "workbench", "--out", out]) == 0
    assert main(["snapshot", str(path), "--size", "120x40", "--keys", "c", "--out", out]) == 0

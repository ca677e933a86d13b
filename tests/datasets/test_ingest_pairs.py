"""`s2r ingest pairs`: from two recordings with known poses to a store."""

import csv
import hashlib
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.language import evaluation
from s2rstore.maintenance.verify import verify
from s2rtools.datasets import layouts
from s2rtools.datasets.floor.floor_poses import FloorOptions
from s2rtools.datasets.layouts import LAYOUTS
from s2rtools.datasets.pairing.pair_matching import PoseTolerance
from s2rtools.datasets.pairing.paired_recordings import PairOptions, scan_pairs
from s2rtools.datasets.pairing.recorded_scan import MapOptions
from s2rtools.datasets.recording import PinholeCamera, Recording, SourceImage
from s2rtools.datasets.recordings.image_frame_source import read_undistorted
from s2rtui.cli import main
from tests.support import recordings
from tests.support.recordings import Side

N = 24


@pytest.fixture(autouse=True)
def known_layout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LAYOUTS, "test", recordings.LAYOUT)


def offsets(n: int, low: float, high: float, seed: int = 1) -> np.ndarray:
    """Displacements (n, 3) of `low` to `high` metres and up to 8 degrees."""
    rng = np.random.default_rng(seed)
    direction, length = rng.uniform(-np.pi, np.pi, n), rng.uniform(low, high, n)
    turn = np.radians(rng.uniform(-8, 8, n))
    return np.column_stack([length * np.cos(direction), length * np.sin(direction), turn])


def loose_recordings(folder: Path, **settings: object) -> tuple[Path, Path, np.ndarray]:
    """A real walk, and a sim one in another order with poses 0.05 to 0.4 m off."""
    real = recordings.walk(N)
    sim = real + offsets(N, 0.05, 0.4)
    order = np.random.default_rng(2).permutation(N)
    one = recordings.write(folder / "sim", recordings.side(sim, order), seed=1, **settings)
    other = recordings.write(folder / "real", recordings.side(real), seed=2, **settings)
    return one, other, sim


def ingest_words(sim: Path, real: Path, store: Path, *more: str) -> list[str]:
    return ["ingest", "pairs", "--sim", f"test:{sim}", "--real", f"test:{real}", "--size", "16",
            "--sim-floor", "ground=0", "--real-floor", "ground=0", "--store", str(store), *more
            ]  # fmt: skip


def ingest(sim: Path, real: Path, store: Path, *more: str) -> int:
    return main(ingest_words(sim, real, store, *more))


def test_loose_pairs_are_found_stored_with_their_offsets_and_selected(tmp_path, capsys):
    sim, real, sim_poses = loose_recordings(tmp_path)
    path = tmp_path / "s.s2r"
    assert ingest(sim, real, path, "--tolerance", "0.45m,10deg") == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(f"pairs: {N} of {N} sim and {N} real images" in line for line in lines)
    truth = recordings.walk(N)
    metres = np.hypot(*(sim_poses - truth)[:, :2].T)
    with s2rstore.open(path) as store:
        frames = store.execute(
            "SELECT s.rgb_path, r.rgb_path, s.sha256 FROM frame s JOIN frame r USING (iid) "
            "WHERE s.domain = 'sim' AND r.domain = 'real' ORDER BY iid"
        )
        names = [f"walk/image-{i:04d}.png" for i in range(N)]
        assert [(a, b) for a, b, _ in frames] == list(zip(names, names, strict=True))
        hashes = [
            hashlib.sha256(file.read_bytes()).hexdigest()
            for file in (sim / names[3], sim / "walk/depth/image-0003.png")
        ]
        assert frames[3][2] == hashlib.sha256("".join(hashes).encode()).hexdigest()
        np.testing.assert_allclose(store.poses("real")[:, :2], truth[:, :2], atol=1e-9)
        np.testing.assert_allclose(store.poses("sim")[:, :2], sim_poses[:, :2], atol=1e-9)
        turned = np.angle(np.exp(1j * (store.poses("sim")[:, 2] - sim_poses[:, 2])))
        np.testing.assert_allclose(turned, 0, atol=1e-9)
        np.testing.assert_allclose(store.instances.pair_offset_m, metres, atol=1e-9)
        assert store.has_loose_pairs
        for text, expected in (
            ("pair_offset_m > 0.2", metres > 0.2),
            ("pair_offset_m <= 0.2 & pair_offset_deg < 180", metres <= 0.2),
        ):
            query = f"SELECT count(*) FROM instance WHERE {text.replace('&', 'AND')}"
            assert store.execute(query) == [(np.count_nonzero(expected),)]
        domain = store.domain("sim")
        assert domain.camera_height == pytest.approx(recordings.HEIGHT)
        assert domain.rgb.fx == pytest.approx(15.0)
        assert domain.rgb.cy == pytest.approx(8.0)
        assert domain.has_depth
        assert domain.depth_scale == 0.001
        row = store.execute("SELECT * FROM frame_pose WHERE domain = 'sim' AND iid = 5")[0]
        np.testing.assert_allclose(row[5:8], [*sim_poses[5, :2], recordings.HEIGHT], atol=1e-9)
        assert math.hypot(*row[8:]) == pytest.approx(1)
    assert verify(path) == []


def test_unmatched_images_are_all_reported_with_the_nearest_one(tmp_path, capsys):
    truth = recordings.walk(N)
    sim = recordings.write(tmp_path / "sim", recordings.side(truth, np.arange(3, N)))
    real = recordings.write(tmp_path / "real", recordings.side(truth, np.arange(N - 1)))
    report = tmp_path / "pairs.csv"
    assert ingest(sim, real, tmp_path / "s.s2r", "--report", str(report)) == 0
    errors = capsys.readouterr().err
    assert "unmatched sim image: 1" in errors
    assert "unmatched real image: 3" in errors
    assert "walk/image-0000.png nearest walk/image-" in errors
    rows = list(csv.DictReader(report.open()))
    assert [row["status"] for row in rows] == [
        *["pair"] * (N - 4), "unmatched sim", *["unmatched real"] * 3,
    ]  # fmt: skip
    first = next(row for row in rows if row["real"] == "walk/image-0002.png")
    step = math.hypot(*(truth[3] - truth[2])[:2])
    assert float(first["offset_m"]) == pytest.approx(step, abs=1e-5)
    assert first["sim"] == "walk/image-0003.png"


def test_times_and_names_pair_recordings_of_other_worlds_and_align_fits_them(tmp_path, capsys):
    truth = recordings.walk(N)
    turned = truth.copy()
    angle, cos, sin = 0.7, math.cos(0.7), math.sin(0.7)
    turned[:, :2] = truth[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + [5.0, -3.0]
    turned[:, 2] += angle
    late = recordings.side(turned)
    late = replace(late, times={"walk": [t + 0.012 for t in late.times["walk"]]})
    sim = recordings.write(tmp_path / "sim", late)
    real = recordings.write(tmp_path / "real", recordings.side(truth))
    assert ingest(sim, real, tmp_path / "no.s2r") == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert "no pairs by --match pose; the nearest" in message
    assert not (tmp_path / "no.s2r").exists()
    for match in ("time", "name"):
        path = tmp_path / f"{match}.s2r"
        assert ingest(sim, real, path, "--match", match, "--align") == 0
        assert "residual of 24 pairs 0.000 m" in capsys.readouterr().out
        with s2rstore.open(path) as store:
            np.testing.assert_allclose(store.poses("sim")[:, :2], truth[:, :2], atol=1e-9)
            assert store.instances.pair_offset_m.max() < 1e-9
            fitted = store.provenance_object("pairs", "alignment")
            assert fitted["angle"] == pytest.approx(-angle)


@pytest.mark.parametrize(
    ("declared", "depth_in_world_units"), [({"camera_height": 0.6}, False), ({"ground": 0.0}, True)]
)
def test_align_fits_the_scale_and_keeps_what_is_in_metres(declared, depth_in_world_units, tmp_path):
    truth = recordings.walk(N)
    sim, real = (
        layouts.read("test", recordings.write(tmp_path / name, recordings.side(truth)))
        for name in ("sim", "real")
    )
    for trajectory in sim.trajectories.values():
        trajectory.poses[:, :3, 3] /= 2.5
    sim.is_metric = False
    if depth_in_world_units:
        sim.depth_scale, sim.depth_in_world_units = 0.001 / 2.5, True
    floors = {"sim": FloorOptions(**declared), "real": FloorOptions(ground=0.0)}
    options = PairOptions("name", None, MapOptions((16, 16)), align=True, floors=floors)  # type: ignore[arg-type]
    found = scan_pairs(sim, real, options)
    domain = found.scan.domains["sim"]
    assert domain.camera_height == pytest.approx(recordings.HEIGHT)
    assert domain.depth_scale == pytest.approx(0.001)
    np.testing.assert_allclose(found.sim.poses, found.real.poses, atol=1e-9)
    assert found.scan.issues == []
    assert any("2.5 metres per unit" in line for line in found.summary)
    assert found.scan.part_provenance["recording:sim"]["metres_per_unit"] == pytest.approx(2.5)


def test_images_without_depth_make_domains_without_depth(tmp_path):
    sim, real, _ = loose_recordings(tmp_path, has_depth=False)
    path = tmp_path / "s.s2r"
    assert main(
        ["ingest", "pairs", "--sim", f"test:{sim}", "--real", f"test:{real}", "--match", "name",
         "--store", str(path)]
    ) == 0  # fmt: skip
    with s2rstore.open(path) as store:
        domain = store.domain("real")
        assert not domain.has_depth
        assert math.isnan(domain.depth_scale)
        assert math.isnan(domain.camera_height)
        frame = store.frame("real", 0)
        assert not frame.valid.any()
        assert store.execute("SELECT count(depth_path) FROM frame") == [(0,)]
        name = store.execute("SELECT rgb_path, sha256 FROM frame WHERE domain = 'real'")[0]
        assert hashlib.sha256((real / name[0]).read_bytes()).hexdigest() == name[1]
        with pytest.raises(RequestError, match="domain real has no depth"):
            store.require_depth(["real"], "this")
    assert not list(path.glob("frames.zarr/*/*/*depth*"))
    assert verify(path) == []


def test_a_lens_is_undistorted_and_invalid_depth_stays_invalid(tmp_path):
    """A straight line of the scene is straight in the stored image."""
    size, k = 96, -0.25
    camera = PinholeCamera(size, size, 60.0, 60.0, size / 2, size / 2, (k, 0.0, 0.0, 0.0))
    truth = recordings.walk(4)
    real = recordings.write(tmp_path / "real", recordings.side(truth), camera)
    sim = recordings.write(tmp_path / "sim", recordings.side(truth), replace(camera, distortion=()))
    image = np.zeros((size, size, 3), dtype=np.uint8)
    rows = np.linspace(0, size, 4 * size)
    for offset in np.linspace(-0.5, 0.5, 9):
        x = (84 + offset - size / 2) / 60  # the line at column 84 of an undistorted image
        y = (rows - size / 2) / 60
        bent = 1 + k * (x * x + y * y)
        points = np.column_stack([60 * x * bent, 60 * y * bent]) + size / 2
        kept = points[((points >= 0) & (points < size)).all(axis=1)].astype(int)
        image[kept[:, 1], kept[:, 0]] = 255
    cv2.imwrite(str(real / "walk" / "image-0000.png"), image)
    more = "--size", str(size)
    assert ingest(sim, real, tmp_path / "s.s2r", *more) == 0
    with s2rstore.open(tmp_path / "s.s2r") as store:
        frame = store.frame("real", 0)
        brightest = frame.rgb[10:-10, 60:, 0].argmax(axis=1) + 60
        assert np.abs(brightest - 84).max() <= 1
        assert store.domain("real").rgb.fx == 60.0
        values = np.unique(store.frames("real", 0, 4, ("depth",))["depth"])
        assert set(values.tolist()) <= {0, 2000}


def test_a_fisheye_lens_without_coefficients_is_undistorted():
    size, focal, angle = 96, 40.0, 0.8
    camera = PinholeCamera(size, size, focal, focal, 48.0, 48.0, (), is_fisheye=True)
    image = np.zeros((size, size, 3), dtype=np.uint8)
    cv2.circle(image, (48, 48), round(focal * angle), (255, 255, 255), 1)

    class Image:
        name = "image"

        def read(self) -> SourceImage:
            return SourceImage(image, "", 8)

    found = read_undistorted(Image(), camera, cv2.INTER_LINEAR)  # type: ignore[arg-type]
    assert isinstance(found, SourceImage)
    radius = int(found.pixels[48, 48:, 0].argmax())
    assert radius == pytest.approx(focal * math.tan(angle), abs=2)


def test_unusable_images_are_reported_and_left_out(tmp_path, capsys):
    sim, real, _ = loose_recordings(tmp_path)
    files = [sim / "walk" / f"image-{number:04d}.png" for number in range(4, 8)]
    files[0].unlink()
    files[1].write_bytes(files[1].read_bytes()[:-400])
    cv2.imwrite(str(files[2]), np.zeros((10, 10, 3), dtype=np.uint8))
    files[3] = sim / "walk" / "depth" / files[3].name
    cv2.imwrite(str(files[3]), np.full((24, 32, 3), (0, 0, 90), dtype=np.uint8))
    more = "--tolerance", "0.45m,10deg"
    assert ingest(sim, real, tmp_path / "s.s2r", *more) == 0
    out, errors = capsys.readouterr()
    for kind in ("unreadable image", "truncated image", "wrong size", "not a depth image"):
        assert f"{kind}: 1" in errors
    for file in files:
        assert f"  sim: {file.relative_to(sim)}" in errors
    assert f"; 4 of {N} pairs left out" in out
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert len(store.instances) == N - 4
    assert verify(tmp_path / "s.s2r") == []
    assert ingest(sim, real, tmp_path / "strict.s2r", "--strict", *more) == 2
    assert not list(tmp_path.glob("*strict*"))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--sim", "nothing"), "give LAYOUT:PATH"),
        (("--sim", "else:x"), "layout 'else': one of"),
        (("--tolerance", "3"), "--tolerance 3"),
        (("--align",), "--match time or --match name"),
        (("--sim-floor", "down=z"), "one of up, ground"),
        (("--sim-option", "a"), "expected NAME=VALUE"),
        (("--real-option", "a=1"), "no option 'a'"),
        (("--size", "2"), "must be 16 to 2048"),
        (("--match", "name", "--header", "cam.toml"), "camera=FILE"),
    ],
)
def test_unusable_requests_end_in_one_line(arguments, words, tmp_path, s2r, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sim, real, _ = loose_recordings(tmp_path)
    Path("cam.toml").write_text("[camera]\nwidth = 32\nheight = 24\nhfov = 90\n")
    s2r(*ingest_words(sim, real, tmp_path / "s.s2r", *arguments)).assert_refused(words)
    assert not (tmp_path / "s.s2r").exists()


def test_a_strict_ingest_lists_all_issues(tmp_path, capsys):
    truth = recordings.walk(N)
    sim = recordings.write(tmp_path / "sim", recordings.side(truth, np.arange(3, N)))
    real = recordings.write(tmp_path / "real", recordings.side(truth))
    cut = [f"walk/image-{number:04d}.png" for number in range(6, 16)]
    for name in cut:
        (real / name).write_bytes((real / name).read_bytes()[:-400])
    assert ingest(sim, real, tmp_path / "s.s2r", "--strict", "--match", "name") == 2
    lines = capsys.readouterr().err.splitlines()
    assert "truncated image: 10" in lines
    assert [line.split()[1] for line in lines if line.startswith("  real: ")] == cut
    assert lines[-1].endswith("; 12 more issues; nothing was ingested")
    assert not (tmp_path / "s.s2r").exists()


def test_a_calibration_file_gives_bounds_and_rooms(tmp_path):
    sim, real, _ = loose_recordings(tmp_path)
    (tmp_path / "lab.toml").write_text(
        'name = "lab"\n[bounds]\nx0 = -9\ny0 = -9\nx1 = 9\ny1 = 9\n'
        '[[rooms]]\nroom = "east"\nrectangles = [[0, -9, 9, 9]]\n'
    )
    more = "--match", "name", "--calibration", str(tmp_path / "lab.toml")
    assert ingest(sim, real, tmp_path / "s.s2r", *more) == 0
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert store.dataset.name == "lab"
        assert store.dataset.bounds.x0 == -9
        room = evaluation.vocabulary(store).rooms
        assert room == ("east",)
        np.testing.assert_array_equal(store.instances.room >= 0, store.instances.x >= 0)


def test_several_trajectories_without_times_are_paired_by_name_within_their_own(tmp_path, capsys):
    truth = recordings.walk(N)
    both = {"a": truth[:10], "b": truth[10:]}
    names = {"a": [f"{i}" for i in range(10)], "b": [f"{i}" for i in range(N - 10)]}
    times = {name: [math.nan] * len(poses) for name, poses in both.items()}
    side = Side(both, names, times)
    sim = recordings.write(tmp_path / "sim", side)
    real = recordings.write(tmp_path / "real", side)
    assert ingest(sim, real, tmp_path / "s.s2r", "--match", "time") == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert "the sim recording (layout test) has no times" in line
    assert line.endswith("match by pose or name")
    assert ingest(sim, real, tmp_path / "s.s2r", "--match", "name") == 0
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert [(t.trajectory, t.instances) for t in store.trajectories] == [("a", 10), ("b", 14)]
        assert not store.has_loose_pairs
        assert np.isnan(store.instances.timestamp).all()


def recordings_of_own_worlds(folder: Path) -> tuple[Recording, Recording]:
    """Trajectories `a` and `b` of the same poses in two worlds; sim `b` has an image more."""
    truth = recordings.walk(N)
    found = []
    for side, count in (("sim", N), ("real", N - 1)):
        poses = {"a": truth[: N - 1], "b": truth[:count]}
        names = {name: [f"{i}" for i in range(len(each))] for name, each in poses.items()}
        times = {name: [math.nan] * len(each) for name, each in poses.items()}
        path = recordings.write(folder / side, Side(poses, names, times))
        found.append(layouts.read("test", path))
    found[1].has_own_worlds = True
    return found[0], found[1]


def test_poses_of_different_worlds_are_not_compared(tmp_path):
    sim, real = recordings_of_own_worlds(tmp_path)
    del real.trajectories["a"]
    real.trajectories["c"] = sim.trajectories["a"]
    floors = {side: FloorOptions(ground=0.0) for side in ("sim", "real")}
    tolerance = PoseTolerance(0.2, 0.2)
    options = PairOptions("pose", tolerance, MapOptions((16, 16)), floors=floors)  # type: ignore[arg-type]
    found = scan_pairs(sim, real, options)
    names = [(found.sim.image(int(a)), found.real.image(int(b)))
             for a, b in zip(found.pairing.sim, found.pairing.real, strict=True)]  # fmt: skip
    assert names == [(f"b/{i}.png", f"b/{i}.png") for i in range(N - 1)]
    assert {each.nearest[:2] for each in found.unmatched} <= {"", "b/"}
    (issue,) = [each for each in found.scan.issues if each.kind == "several worlds"]
    assert issue.file == "real: real"


def test_align_refuses_several_worlds(tmp_path):
    sim, real = recordings_of_own_worlds(tmp_path)
    options = PairOptions("name", None, MapOptions((16, 16)), align=True)
    with pytest.raises(RequestError, match="choose one by --sim-trajectory and --real-trajectory"):
        scan_pairs(sim, real, options)

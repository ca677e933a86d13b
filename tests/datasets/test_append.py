"""Appending trajectories to a store: what is added, what stays, what is refused."""

from __future__ import annotations

import hashlib
import json
import shutil
import tarfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout
from s2rstore.files.ingest_folder import appending_folder, appending_folders
from s2rstore.index import transaction
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import check, verify
from s2rtools.datasets import IMPORTERS, append, build
from s2rtools.datasets.image_decoding import ImageFiles
from s2rtools.datasets.scan import Scan, ScanOptions
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe
from tests.datasets.helpers import SIZE, ingest, kinds
from tests.support import image_folders, pairs
from tests.support.copies import copy_store

N = 8


def scan_of(name: str, path: Path, **options) -> Scan:
    return IMPORTERS[name](path, ScanOptions(**{"frame": SIZE, **options}))


def add(
    scan: Scan, store: Path, strict: bool = False, lines: list[str] | None = None
) -> dict[str, int]:
    said = [] if lines is None else lines
    return append.append(scan, store, "s2r ingest", strict, lambda steps: None, said.append)


def files(store: Path) -> dict[str, str]:
    """SHA-256 of the files that no generation may change."""
    return {
        path.relative_to(store).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in store.rglob("*")
        if path.is_file()
        and path.relative_to(store).parts[0] in (layout.FRAMES, layout.INDEX, layout.ASSETS)
    }


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Trajectories `a`, `c` and `b` of the Sim2RealViz layout, and their calibration."""
    folder = tmp_path_factory.mktemp("source")
    return folder, pairs.sim2realviz(folder, n=N, trajectories=("a", "c", "b"))


@pytest.fixture(scope="module")
def first_store(source: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of trajectory `c`."""
    store = tmp_path_factory.mktemp("first") / "s.s2r"
    ingest("sim2realviz", source[0], store, header=source[1], trajectories=("c",))
    return store


@pytest.fixture
def store(first_store: Path, tmp_path: Path) -> Path:
    return copy_store(first_store, tmp_path / "s.s2r")


@pytest.fixture
def scan(source: tuple[Path, Path]) -> Scan:
    return scan_of("sim2realviz", source[0], header=source[1])


def rows_by_trajectory(store: Path) -> dict[str, object]:
    """All rows of instances, frames and trajectories without iids, and the frames themselves."""
    with s2rstore.open(store) as opened:
        found: dict[str, object] = {
            "trajectory": opened.execute("FROM trajectory ORDER BY trajectory"),
            "room": opened.execute("FROM room ORDER BY position"),
            "domain": opened.execute("FROM domain ORDER BY domain"),
            "instance": opened.execute(
                "SELECT * EXCLUDE (iid) FROM instance ORDER BY trajectory, seq"
            ),
            "frame": opened.execute(
                "SELECT trajectory, seq, frame.* EXCLUDE (iid) FROM frame JOIN instance USING "
                "(iid) ORDER BY trajectory, seq, domain"
            ),
            "checksums": dict(opened.checksums),
        }
        for domain in opened.domains:
            images = opened.frames(domain, 0, len(opened.instances))
            for trajectory in opened.trajectories:
                first = opened.first_iid(trajectory.trajectory)
                rows = slice(first, first + trajectory.instances)
                digest = hashlib.sha256(images["rgb"][rows].tobytes())
                digest.update(images["depth"][rows].tobytes())
                found[f"{domain} {trajectory.trajectory}"] = digest.hexdigest()
    return found


def test_appending_equals_ingesting_at_once_except_for_the_iids(
    source: tuple[Path, Path], scan: Scan, store: Path, tmp_path: Path
) -> None:
    ingest("sim2realviz", source[0], tmp_path / "once.s2r", header=source[1])
    assert add(scan, store) == {"a": N, "b": N}
    assert rows_by_trajectory(store) == rows_by_trajectory(tmp_path / "once.s2r")
    assert verify(store) == []
    assert check(store).notes == ()


def test_existing_iids_frames_and_index_files_stay(scan: Scan, store: Path) -> None:
    before = files(store)
    with s2rstore.open(store) as opened:
        rows = opened.execute("FROM instance ORDER BY iid"), opened.execute("FROM frame")
        frame = opened.frame(3, "real").rgb
    add(scan, store)
    after = files(store)
    assert {path: after[path] for path in before} == before
    with s2rstore.open(store) as opened:
        assert opened.generation == 2
        assert opened.execute(f"FROM instance WHERE iid < {N} ORDER BY iid") == rows[0]
        assert sorted(opened.execute(f"FROM frame WHERE iid < {N}")) == sorted(rows[1])
        assert (opened.frame(3, "real").rgb == frame).all()


def test_trajectories_are_in_the_order_of_their_instances(scan: Scan, store: Path) -> None:
    add(scan, store)
    with s2rstore.open(store) as opened:
        assert [t.trajectory for t in opened.trajectories] == ["c", "a", "b"]
        truth = opened.instances
        assert truth.trajectory.tolist() == [0] * N + [1] * N + [2] * N
        assert [opened.first_iid(name) for name in "cab"] == [0, N, 2 * N]
        both = opened.frames("sim", N - 2, N + 2)["rgb"]
        for row, iid in enumerate(range(N - 2, N + 2)):
            assert (both[row] == opened.frame(iid, "sim").rgb).all()
        expected = opened.frames_array("sim", "a", "rgb")[0]
        assert (opened.frame(N, "sim").rgb == expected).all()


def test_parts_hash_and_provenance(scan: Scan, store: Path, source: tuple[Path, Path]) -> None:
    with s2rstore.open(store) as opened:
        original, facts = opened.dataset.hash, opened.provenance("dataset")
        assert opened.identity == original
    for name in ("b", "a"):
        add(scan_of("sim2realviz", source[0], header=source[1], trajectories=(name,)), store)
    with s2rstore.open(store) as opened:
        parts = opened.parts
        assert [(p.part, p.first_iid, p.instances) for p in parts] == [
            (0, 0, N), (1, N, N), (2, 2 * N, N)
        ]  # fmt: skip
        assert parts[0].hash == original == opened.identity
        assert parts[0].added_at == facts["ingested_at"]
        assert len({part.hash for part in parts}) == 3
        joined = "".join(part.hash for part in parts)
        assert opened.dataset.hash == hashlib.sha256(joined.encode()).hexdigest()
        assert layout.read_current(store).dataset_hash == opened.dataset.hash
        now = opened.provenance("dataset")
        assert facts.items() <= now.items()
        added = json.loads(now["append:2"])
        assert added["command"] == "s2r ingest"
        assert added["trajectories"] == {"a": N}
        assert added["problems"] == {}


def test_the_hash_of_a_part_depends_on_its_poses_and_images(
    scan: Scan, first_store: Path, tmp_path: Path
) -> None:
    hashes = []
    for number, names in enumerate((("a",), ("a",), ("b",))):
        copy = copy_store(first_store, tmp_path / f"{number}.s2r")
        add(replace(scan, trajectories={name: scan.trajectories[name] for name in names}), copy)
        with s2rstore.open(copy) as opened:
            hashes.append(opened.parts[1].hash)
    assert hashes[0] == hashes[1] != hashes[2]


def test_a_trajectory_of_the_store_is_skipped_and_nothing_new_publishes_nothing(
    scan: Scan, store: Path
) -> None:
    lines: list[str] = []
    add(scan, store, lines=lines)
    assert lines == ["trajectory c: already in the store"]
    before = files(store)
    lines.clear()
    assert add(scan, store, lines=lines) == {}
    assert lines[:3] == [f"trajectory {name}: already in the store" for name in "abc"]
    assert "nothing to append" in lines[3]
    assert files(store) == before


def test_an_unusable_pair_that_was_left_out_does_not_make_a_difference(tmp_path: Path) -> None:
    header = pairs.sim2realviz(tmp_path / "data", n=N, trajectories=("a", "b"))
    image = sorted((tmp_path / "data" / "a" / "real").glob("*_rgb.jpeg"))[2]
    image.write_bytes(image.read_bytes()[:300])
    store = tmp_path / "s.s2r"
    first = ingest("sim2realviz", tmp_path / "data", store, header=header, trajectories=("a",))
    assert sum(kinds(first).values()) == 1
    assert add(scan_of("sim2realviz", tmp_path / "data", header=header), store) == {"b": N}


def test_other_images_or_poses_of_a_stored_trajectory_are_refused(tmp_path: Path) -> None:
    manifest = pairs.manifest(tmp_path / "data")
    store = tmp_path / "s.s2r"
    ingest("csv", manifest, store, trajectories=("a",))
    before = files(store)
    text = manifest.read_text()
    first = text.splitlines()[1]
    manifest.write_text(text.replace(first.split(",")[5], "6.9"))
    with pytest.raises(RequestError, match="trajectory a: the source differs"):
        add(scan_of("csv", manifest), store)
    manifest.write_text(text)
    shutil.copy(tmp_path / "data" / "sim" / "1_rgb.png", tmp_path / "data" / "sim" / "0_rgb.png")
    with pytest.raises(RequestError, match=r"trajectory a: the source differs.*another name"):
        add(scan_of("csv", manifest), store)
    assert files(store) == before


def test_a_shorter_or_longer_recording_of_a_stored_trajectory_is_refused(
    scan: Scan, store: Path
) -> None:
    for records in (
        scan.trajectories["c"][:-1],
        [*scan.trajectories["c"], scan.trajectories["a"][0]],
    ):
        scan.trajectories["c"] = records
        with pytest.raises(RequestError, match="trajectory c: the source differs"):
            add(scan, store)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("accuracy_scale = 10.0", "accuracy_scale = 11.0", "another accuracy_scale: 11 m"),
        ("y_down = true", "y_down = false", "another y_down"),
        ("camera_height = 0.6", "camera_height = 0.7", "another camera_height of domain sim: 0.7"),
        ("hfov = 70.0", "hfov = 71.0", "another rgb_fx of domain real"),
        ("depth_raw_max = 249", "depth_raw_max = 248", "another depth_raw_max of domain sim"),
        ('kind = "sim"', 'kind = "real"', "another kind of domain sim: real, the store sim"),
    ],
)
def test_another_calibration_is_refused_by_name(
    source: tuple[Path, Path], store: Path, tmp_path: Path, old: str, new: str, message: str
) -> None:
    header = tmp_path / "other.toml"
    header.write_text(source[1].read_text().replace(old, new))
    before = files(store)
    with pytest.raises(RequestError, match=message):
        add(scan_of("sim2realviz", source[0], header=header), store)
    assert files(store) == before


def test_another_frame_size_and_other_domains_are_refused(
    source: tuple[Path, Path], store: Path, tmp_path: Path
) -> None:
    with pytest.raises(RequestError, match=r"frame size \(--size\): 48x48, the store 32x32"):
        add(scan_of("sim2realviz", source[0], header=source[1], frame=(48, 48)), store)
    header = pairs.sim2realviz(tmp_path / "data", n=N, trajectories=("d",), edit=True)
    with pytest.raises(RequestError, match="set of domains: real, sim, sim_edit, the store real"):
        add(scan_of("sim2realviz", tmp_path / "data", header=header), store)
    folders = image_folders.folders(tmp_path / "images")
    with pytest.raises(RequestError, match="kind of data: images without poses"):
        add(scan_of("images", Path(), folders=folders), store)


def test_cameras_that_differ_by_rounding_agree(scan: Scan, store: Path) -> None:
    domain = scan.domains["sim"]
    scan.domains["sim"] = replace(domain, depth_scale=np.nextafter(domain.depth_scale, 1))
    assert add(scan, store) == {"a": N, "b": N}


def test_no_store_is_made(scan: Scan, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="leave out --append"):
        add(scan, tmp_path / "missing.s2r")
    assert not (tmp_path / "missing.s2r").exists()


def test_bounds_rooms_and_floor_plan_of_the_store_are_kept_and_others_reported(
    source: tuple[Path, Path], store: Path, tmp_path: Path
) -> None:
    text = source[1].read_text().replace("x1 = 8.0", "x1 = 6.0").replace('"west"', '"front"')
    header = tmp_path / "other.toml"
    header.write_text(text)
    with s2rstore.open(store) as opened:
        dataset, rooms = opened.dataset, opened.rooms
    other = scan_of("sim2realviz", source[0], header=header)
    other.floor_plan = np.full((40, 60, 3), 99, np.uint8)
    with pytest.raises(RequestError, match="bounds"):
        add(other, store, strict=True)
    other.issues.clear()
    add(other, store)
    assert kinds(other) == {"other bounds": 1, "other rooms": 1, "other floor plan": 1}
    with s2rstore.open(store) as opened:
        assert (opened.dataset.bounds, opened.rooms) == (dataset.bounds, rooms)
        assert opened.dataset.floor_plan is None
        truth = opened.instances
        assert (truth.room[:N] == truth.room[N : 2 * N]).all()
        recorded = json.loads(opened.provenance("dataset")["append:1"])["problems"]
        assert recorded == kinds(other)


def test_the_same_floor_plan_is_not_reported(
    source: tuple[Path, Path], scan: Scan, tmp_path: Path
) -> None:
    plan = np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8)
    first = scan_of("sim2realviz", source[0], header=source[1], trajectories=("c",))
    first.floor_plan = scan.floor_plan = plan
    build.build(first, tmp_path / "s.s2r", "s2r ingest", False, lambda steps: None)
    add(scan, tmp_path / "s.s2r", strict=True)
    assert scan.issues == []


def test_poses_outside_the_bounds_of_the_store_are_reported(scan: Scan, store: Path) -> None:
    scan.trajectories["a"][0] = replace(scan.trajectories["a"][0], x=99.0)
    add(scan, store)
    assert kinds(scan) == {"pose outside the bounds": 1}


def test_an_unusable_pair_is_left_out_and_strict_refuses_it(tmp_path: Path) -> None:
    header = pairs.sim2realviz(tmp_path / "data", n=N, trajectories=("a", "b"))
    store = tmp_path / "s.s2r"
    ingest("sim2realviz", tmp_path / "data", store, header=header, trajectories=("a",))
    image = sorted((tmp_path / "data" / "b" / "sim").glob("*_depth.jpeg"))[1]
    image.write_bytes(b"")
    options = {"header": header, "trajectories": ("b",)}
    before = files(store)
    with pytest.raises(RequestError, match="nothing was ingested"):
        add(scan_of("sim2realviz", tmp_path / "data", **options), store, strict=True)
    assert files(store) == before
    assert not appending_folders(store)
    assert add(scan_of("sim2realviz", tmp_path / "data", **options), store) == {"b": N - 1}
    assert verify(store) == []


def test_images_without_poses_can_be_appended(tmp_path: Path) -> None:
    sources = image_folders.folders(tmp_path / "data")
    frame = (64, 64)
    names = ("real_day", "sim_loop")
    store = tmp_path / "s.s2r"
    image_folders.ingest(sources, store, trajectories=names)
    lines: list[str] = []
    added = add(scan_of("images", Path(), folders=sources, frame=frame), store, lines=lines)
    assert added == {"real_night": 3, "sim_city": 2}
    assert lines == [f"trajectory {name}: already in the store" for name in names]
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert [t.trajectory for t in opened.trajectories] == [*names, "real_night", "sim_city"]
        assert opened.imaged_trajectories["real"] == {"real_day", "real_night"}
        assert opened.imaged("real").tolist() == [True] * 4 + [False] * 5 + [True] * 3 + [False] * 2
        assert opened.frames("real", 9, 12)["rgb"].shape == (3, 32, 64, 3)


def test_the_synthetic_world_grows_with_the_same_recipe_only(tmp_path: Path) -> None:
    world = {"seed": 3, "count": 4}
    store = tmp_path / "w.s2r"
    ingest("world", Path(), store, world=world, trajectories=("traj2",))
    with pytest.raises(RequestError, match="another recipe of"):
        add(scan_of("world", Path(), world={"seed": 3, "count": 5}), store)
    assert add(scan_of("world", Path(), world=world), store) == {"traj1": 4}
    ingest("world", Path(), tmp_path / "once.s2r", world=world)
    assert rows_by_trajectory(store)["frame"] == rows_by_trajectory(tmp_path / "once.s2r")["frame"]
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        data = WorldData(WorldRecipe(**world, frame=SIZE[0]))
        assert data.matches(opened)
        assert data.noise_numbers(opened).tolist() == [
            *range(1_000_000, 1_000_004), *range(4)
        ]  # fmt: skip


def test_a_store_of_version_0_1_0_can_be_appended_to(tmp_path: Path) -> None:
    archive = Path(__file__).parents[1] / "fixtures" / "store-0.1.0" / "store.tar.xz"
    with tarfile.open(archive) as packed:
        packed.extractall(tmp_path, filter="data")
    (store,) = tmp_path.glob("*.s2r")
    before = files(store)
    with s2rstore.open(store) as opened:
        old, domains = opened.dataset, dict(opened.domains)
        count, bounds = len(opened.instances), old.bounds
        runs = list(opened.runs)
    assert verify(store) == []
    header = pairs.sim2realviz(tmp_path / "data", n=N, trajectories=("zz",))
    added = scan_of("sim2realviz", tmp_path / "data", header=header,
                    frame=(old.frame_height, old.frame_width))  # fmt: skip
    added.y_down, added.bounds, added.accuracy_scale = old.y_down, bounds, old.accuracy_scale
    added.domains = domains
    for name in ("sim", "real"):
        assert name in added.trajectories["zz"][0].sources
    assert add(added, store) == {"zz": N}
    after = files(store)
    assert {path: after[path] for path in before} == before
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert len(opened.instances) == count + N
        assert opened.identity == old.hash != opened.dataset.hash
        valid = opened.run_columns(runs[0]).valid
        assert valid[:count].any()
        assert not valid[count:].any()
    assert any("computed for" in note for note in check(store).notes)


class Killed(BaseException):
    """Stands for the end of the process at this point."""


def _kill(*arguments: object, **options: object) -> None:
    raise Killed


def _kill_after(function: Callable[..., object], calls: int) -> Callable[..., object]:
    done = 0

    def counted(*arguments: object, **options: object) -> object:
        nonlocal done
        if done == calls:
            raise Killed
        done += 1
        return function(*arguments, **options)

    return counted


@pytest.mark.parametrize(
    "point",
    ["frames", "second trajectory", "entries", "before moving", "first move", "third move",
     "ledger", "checksums", "rows", "index file", "current"],
)  # fmt: skip
def test_a_kill_leaves_the_old_generation_and_a_rerun_succeeds(
    scan: Scan, store: Path, monkeypatch: pytest.MonkeyPatch, point: str
) -> None:
    """The building folder stays, too, as after a real kill."""
    before, current = files(store), layout.read_current(store)
    moves = {"before moving": 0, "first move": 1, "third move": 3}
    with monkeypatch.context() as patch:
        patch.setattr(append.shutil, "rmtree", lambda *arguments, **options: None)
        if point in moves:
            patch.setattr(atomic_writes, "move", _kill_after(atomic_writes.move, moves[point]))
        elif point == "second trajectory":
            patch.setattr(build, "_write_trajectory", _kill_after(build._write_trajectory, 1))
        else:
            owner, name = {
                "frames": (append, "write_frames"),
                "entries": (append, "_checked_entries"),
                "ledger": (append.Ledger, "add_entries"),
                "checksums": (transaction.IndexTransaction, "record_checksums"),
                "rows": (append, "insert_instances"),
                "index file": (transaction, "_publish"),
                "current": (layout, "write_current"),
            }[point]
            patch.setattr(owner, name, _kill)
        with pytest.raises(Killed):
            add(scan, store)
    assert layout.read_current(store) == current
    after = files(store)
    assert {path: after[path] for path in before} == before
    assert verify(store) == []
    assert add(scan, store) == {"a": N, "b": N}
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert len(opened.instances) == 3 * N


def test_prune_removes_unreferenced_frames_and_keeps_all_others(
    scan: Scan, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(append, "insert_instances", _kill)
        with pytest.raises(Killed):
            add(scan, store)
    leftovers = {f"{layout.FRAMES}/{domain}/{name}" for domain in ("sim", "real") for name in "ab"}
    assert leftovers <= set(prune(store, dry_run=True).paths)
    assert set(prune(store).paths) == leftovers
    assert verify(store) == []
    add(scan, store)
    assert prune(store, keep=1).paths == ("index/index-000001.duckdb",)
    assert verify(store) == []
    with s2rstore.open(store) as opened:
        assert opened.frame(0, "sim").rgb.any()


def test_prune_keeps_the_folder_in_which_another_process_appends(store: Path) -> None:
    folder = appending_folder(store)
    (folder / "ledger").mkdir(parents=True)
    (folder / ".x.partial").write_bytes(b"1")
    assert prune(store).paths == ()
    assert (folder / ".x.partial").exists()
    assert verify(store) == []


def test_frames_of_a_kept_generation_are_never_replaced(scan: Scan, store: Path) -> None:
    """A user has put back an older generation of the data under a new number."""
    old = layout.read_current(store)
    add(scan, store)
    third = layout.index_name(3)
    shutil.copy(store / old.index, store / third)
    layout.write_current(
        store,
        layout.Current(3, third, old.sha256, old.bytes, old.schema, old.dataset_hash),
    )
    before = files(store)
    with pytest.raises(RequestError, match="a kept generation has these frames"):
        add(scan, store)
    assert files(store) == before


def test_two_appends_do_not_mix(
    scan: Scan, source: tuple[Path, Path], store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = scan_of("sim2realviz", source[0], header=source[1], trajectories=("a",))
    checked = append._checked_entries

    def interrupted(folder: Path) -> object:
        entries = checked(folder)
        monkeypatch.setattr(append, "_checked_entries", checked)
        add(other, store)
        return entries

    monkeypatch.setattr(append, "_checked_entries", interrupted)
    with pytest.raises(RequestError, match="append again"):
        add(scan, store)
    assert add(scan, store) == {"b": N}
    assert verify(store) == []


def test_an_image_is_decoded_once_and_compared_ones_not_at_all(
    scan: Scan, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[Path] = []
    decode = ImageFiles.decode

    def counted(self: ImageFiles, *arguments: object) -> object:
        decoded.append(self.rgb)
        return decode(self, *arguments)

    monkeypatch.setattr(ImageFiles, "decode", counted)
    add(scan, store)
    assert len(decoded) == len(set(decoded)) == 2 * 2 * N
    assert not any("/c/" in path.as_posix() for path in decoded)


def _is_shard(path: Path) -> bool:
    return path.is_file() and path.name != "zarr.json"


def test_damaged_frames_are_not_moved(
    scan: Scan, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = append.write_frames

    def damaged(*arguments: object) -> object:
        stored = write(*arguments)
        shard = next(path for path in arguments[1].rglob("a/rgb/**/*") if _is_shard(path))
        shard.write_bytes(shard.read_bytes()[:-1])
        return stored

    monkeypatch.setattr(append, "write_frames", damaged)
    with pytest.raises(RequestError, match="differs from what was written"):
        add(scan, store)
    assert verify(store) == []


def test_progress_adds_up(scan: Scan, store: Path) -> None:
    steps: list[int] = []
    append.append(scan, store, "s2r ingest", False, steps.append)
    assert sum(steps) == 2 * 2 * 3 * N

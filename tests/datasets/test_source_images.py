"""Images at the size of their source, which networks see, beside the frames of a store."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import check, verify
from s2rtools.datasets.writing.build import build
from s2rtools.models import build_network
from s2rtools.models.model_registration import pack_weights, register_model
from s2rtools.precompute.frame_reader import read_pairs
from s2rtools.precompute.run_registration import insert_run
from tests.datasets.helpers import SIZE, scan_of
from tests.support import pairs

SOURCE = pairs.HEIGHT, pairs.WIDTH


def ingested(folder: Path, store: Path, frame: tuple[int, int] = SIZE) -> Path:
    scan = scan_of("sim2realviz", folder, header=folder / "calibration.toml", frame=frame)
    build(scan, store, "", False, lambda steps: None)
    return store


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    pairs.sim2realviz(folder, 5, ("a", "b"))
    return folder


def test_images_are_kept_as_the_files_hold_them(data, tmp_path):
    path = ingested(data, tmp_path / "s.s2r")
    with s2rstore.open(path) as store:
        assert store.source_size("sim", 0) == {"rgb": list(SOURCE), "depth": list(SOURCE)}
        files = store.execute("SELECT rgb_path, depth_path FROM frame WHERE domain = 'real'")
        ((first, images), (second, others)) = store.source_frames("real", 3, 7)
        assert (first, second, len(images["rgb"]), len(others["depth"])) == (3, 5, 2, 2)
        rgb = np.concatenate([images["rgb"], others["rgb"]])
        for row, (rgb_file, depth_file) in enumerate(files[3:7]):
            expected = cv2.imread(str(data / rgb_file))[..., ::-1]
            np.testing.assert_array_equal(rgb[row], expected)
            depth = cv2.imread(str(data / depth_file), cv2.IMREAD_UNCHANGED)
            stored = (images if row < 2 else others)["depth"][row % 2]
            np.testing.assert_array_equal(stored, depth)
            small = cv2.resize(expected, SIZE, interpolation=cv2.INTER_AREA)
            np.testing.assert_array_equal(store.frame("real", 3 + row).rgb, small)
    report = check(path)
    assert (report.damages, report.notes) == ((), ())


def test_frames_of_the_size_of_their_source_are_stored_once(data, tmp_path):
    path = ingested(data, tmp_path / "s.s2r", frame=SOURCE)
    assert not list(path.glob("frames.zarr/*/*/source_*"))
    with s2rstore.open(path) as store:
        assert store.source_size("sim", 0) is None
        ((_, block), _) = store.source_frames("sim", 0, 10)
        np.testing.assert_array_equal(block["rgb"], store.frames("sim", 0, 5)["rgb"])
    assert check(path).notes == ()


def test_damage_of_source_images_is_found(data, tmp_path):
    path = ingested(data, tmp_path / "s.s2r")
    (shard,) = path.glob("frames.zarr/sim/a/source_rgb/c.*")
    content = bytearray(shard.read_bytes())
    content[40] ^= 1
    shard.write_bytes(content)
    assert [damage.where for damage in verify(path)] == [shard.relative_to(path).as_posix()]
    shard.unlink()
    (damage,) = verify(path)
    assert damage.what == "missing; restore it from a copy of the store, or ingest again"


def test_adjustments_apply_before_the_images_are_resized(data, tmp_path):
    path = ingested(data, tmp_path / "s.s2r")
    network = build_network("resposenet").eval()
    chain = [{"name": "brightness", "value": 2.5}, {"name": "depth_blur", "value": 1.0}]
    with edit(path) as draft:
        register_model(path, draft, "m", pack_weights(network), network.convention)
        insert_run(draft, "r", "m", ("sim", "real"), {"sim": [], "real": chain})
    with s2rstore.open(path) as store:
        ((_, pair),) = read_pairs(store, store.run("r"), network.contract, 0, 2, 2)
        ((_, images),) = store.source_frames("real", 0, 2)
        table = np.clip(np.rint(np.arange(256) * 2.5), 0, 255).astype(np.uint8)
        bright = table[images["rgb"]]
        large = [cv2.resize(each, (128, 128), interpolation=cv2.INTER_LINEAR) for each in bright]
        expected = np.moveaxis(np.stack(large) / 127.5 - 1, -1, 1)
        np.testing.assert_allclose(pair["real"].x[:, :3], expected, atol=1e-6)
        shown = table[store.frames("real", 0, 2)["rgb"]]
        np.testing.assert_array_equal(pair["real"].rgb, shown)
        assert pair["real"].depth.shape == (2, *SIZE)
        assert (pair["sim"].depth == store.frames("sim", 0, 2)["depth"]).all()

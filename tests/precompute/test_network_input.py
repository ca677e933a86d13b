"""Predictions against plain scripts that use OpenCV and torch alone."""

import csv
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch import nn

import s2rstore
from s2rstore.maintenance.verify import check
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.models.model_registration import add_model
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import add_run
from s2rtui.cli import main
from tests.support import networks, pairs
from tests.support.silent_reporter import SilentReporter

PAIRS = 2
"""Per trajectory; few enough that the projection needs no fit."""
Images = list[tuple[Path, Path]]
Load = Callable[[Path, Path], np.ndarray]


def load_as_authors(rgb: Path, depth: Path) -> np.ndarray:
    """x (4, 256, 256): `cv2.resize` by default, then [-1, 1]."""
    colours = cv2.cvtColor(cv2.resize(cv2.imread(str(rgb)), (256, 256)), cv2.COLOR_BGR2RGB)
    grey = cv2.resize(cv2.imread(str(depth), cv2.IMREAD_UNCHANGED), (256, 256))
    merged = np.append(colours, grey[..., None], axis=2).astype(np.float32) / 255
    return ((merged - 0.5) / 0.5).transpose(2, 0, 1)


def load_by_area(rgb: Path, depth: Path) -> np.ndarray:
    """As `load_as_authors`, resized by area and by the nearest pixel."""
    colours, grey = cv2.imread(str(rgb)), cv2.imread(str(depth), cv2.IMREAD_UNCHANGED)
    colours = cv2.resize(colours[..., ::-1], (256, 256), interpolation=cv2.INTER_AREA)
    grey = cv2.resize(grey, (256, 256), interpolation=cv2.INTER_NEAREST_EXACT)
    merged = np.append(colours, grey[..., None], axis=2).astype(np.float32) / 255
    return ((merged - 0.5) / 0.5).transpose(2, 0, 1)


def load_for_imagenet(rgb: Path, depth: Path) -> np.ndarray:
    """x (3, 96, 128) with the mean and deviation of ImageNet."""
    colours = cv2.cvtColor(cv2.resize(cv2.imread(str(rgb)), (128, 96)), cv2.COLOR_BGR2RGB) / 255
    x = (colours - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225]
    return x.transpose(2, 0, 1).astype(np.float32)


def outputs(network: nn.Module, images: Images, load: Load) -> np.ndarray:
    with torch.inference_mode():
        return np.concatenate([network(torch.from_numpy(load(*each))[None]) for each in images])


def lively(network: nn.Module, images: Images, load: Load, turn: float) -> nn.Module:
    """Give batch norm the statistics of these images, and the outputs a spread of metres.

    `turn` is the spread of the outputs after x and y.
    """
    x = torch.from_numpy(np.stack([load(*each) for each in images]))
    with torch.inference_mode():
        for module in network.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.momentum = None
        network.train()(x)
        raw = network.eval()(x)
    last = [module for module in network.modules() if isinstance(module, nn.Linear)][-1]
    spread = torch.tensor([4.0, 4.0] + [turn] * (raw.shape[1] - 2)) / raw.std(dim=0)
    with torch.no_grad():
        last.weight.mul_(spread[:, None])
        last.bias.mul_(spread)
    return network.requires_grad_(False)


def poses_of(store: s2rstore.reader.Store, run: str, side: str) -> np.ndarray:
    columns = store.run_columns(run).side(side)
    return np.stack([columns.x, columns.y, columns.heading], axis=1)


def source_files(root: Path, store: Path, domain: str) -> Images:
    query = f"SELECT rgb_path, depth_path FROM frame WHERE domain = '{domain}' ORDER BY iid"
    with s2rstore.open(store) as opened:
        return [(root / rgb, root / depth) for rgb, depth in opened.execute(query)]


def angle(difference: np.ndarray) -> np.ndarray:
    return np.abs((difference + np.pi) % (2 * np.pi) - np.pi)


@pytest.fixture(scope="module")
def real_subset(real_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some pairs of trajectory 1, as two trajectories of the published layout."""
    root = tmp_path_factory.mktemp("real") / "data_source" / "traj_cap"
    with (real_data / "traj1" / "sim" / "match.csv").open() as file:
        rows = list(csv.DictReader(file))
    rows = rows[:: len(rows) // (2 * PAIRS)][: 2 * PAIRS]
    for name, chosen in (("traj1", rows[:PAIRS]), ("traj2", rows[PAIRS:])):
        for domain, key in (("sim", "SIM_RGB"), ("sim_edit", "SIM_RGB"), ("real", "REAL_RGB")):
            folder = root / name / domain
            folder.mkdir(parents=True)
            for row in chosen:
                for file_name in (row[key], row[key].replace("_rgb", "_depth")):
                    shutil.copy(real_data / "traj1" / domain / file_name, folder)
        with (root / name / "sim" / "match.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, ["REAL_RGB", "SIM_RGB"], extrasaction="ignore")
            writer.writeheader()
            writer.writerows(chosen)
    return root


def ingested(root: Path, store: Path, header: Path | None = None) -> Path:
    scan = IMPORTERS["sim2realviz"](root, ScanOptions(header=header))
    build(scan, store, "s2r ingest", False, lambda steps: None)
    return store


def test_posest_predicts_as_a_plain_script_does(real_subset, tmp_path):
    """`sim` and `real` are 640 x 480 pixels, `sim_edit` is 255 x 255."""
    store = ingested(real_subset, tmp_path / "s.s2r")
    files = {name: source_files(real_subset, store, name) for name in ("sim", "sim_edit", "real")}
    torch.manual_seed(1)
    network = lively(networks.PlainPosEst(), [*files["sim"], *files["real"]], load_as_authors, 60.0)
    torch.save(network.state_dict(), tmp_path / "posest.pth")
    add_model(store, "authors", tmp_path / "posest.pth", "posest", None, False)
    for name, domain in (("plain", "sim"), ("edited", "sim_edit")):
        add_run(store, name, "authors", domain, "real", {"sim": [], "real": []})
    precompute(store, SilentReporter(), [], PrecomputeOptions(kinds=()))
    with s2rstore.open(store) as opened:
        for run, side, domain in (
            ("plain", "sim", "sim"), ("plain", "real", "real"), ("edited", "sim", "sim_edit")
        ):  # fmt: skip
            raw = outputs(network, files[domain], load_as_authors)
            poses = poses_of(opened, run, side)
            offset = np.hypot(*(poses[:, :2] - raw[:, :2]).T)
            turn = angle(poses[:, 2] - (-np.pi / 2 - np.radians(raw[:, 2])))
            assert offset.max() < 0.001
            assert np.degrees(turn).max() < 0.1
            assert raw[:, :2].std(axis=0).min() > 1
            other = outputs(network, files[domain], load_by_area)
            if domain != "sim_edit":  # the test would notice other ways of resizing
                assert np.median(np.hypot(*(other - raw)[:, :2].T)) > 0.05
    assert check(store).notes == ()


class RgbNetwork(nn.Module):
    """An ordinary small classifier body with four outputs; it knows nothing of this program."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(3, 16, 5, stride=3), nn.BatchNorm2d(16), nn.ReLU(),
            nn.Conv2d(16, 24, 3, stride=2), nn.ReLU(), nn.AdaptiveAvgPool2d(3), nn.Flatten(),
        )  # fmt: skip
        self.out = nn.Linear(216, 4)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.out(self.body(x))


IMAGENET = """
channels = "rgb"
size = [96, 128]
rgb_interpolation = "bilinear"
mean = [0.485, 0.456, 0.406]
std = [0.229, 0.224, 0.225]
convention = "cos_sin,map"
"""


def save(network: nn.Module, file: Path) -> str:
    """Write a network as an archive; return the architecture to name."""
    x = torch.zeros(2, 3, 96, 128)
    if file.suffix == ".pt":
        torch.jit.save(torch.jit.trace(network, x), str(file))
        return "torchscript"
    batch = {"x": {0: torch.export.Dim("batch", min=1, max=64)}}
    torch.export.save(torch.export.export(network, (x,), dynamic_shapes=batch), file)
    return "torch.export"


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("name", ["net.pt", "net.pt2"])
def test_an_rgb_network_with_imagenet_statistics_comes_in_by_toml(tmp_path, name):
    header = pairs.sim2realviz(tmp_path / "data", PAIRS, ("traj1", "traj2"))
    store = ingested(tmp_path / "data", tmp_path / "s.s2r", header)
    files = {side: source_files(tmp_path / "data", store, side) for side in ("sim", "real")}
    torch.manual_seed(2)
    images = [*files["sim"], *files["real"]]
    network = lively(RgbNetwork(), images, load_for_imagenet, 1.0)
    arch = save(network, tmp_path / name)
    (tmp_path / "net.toml").write_text(IMAGENET)
    command = ["model", "add", "rgb", str(tmp_path / name), "--arch", arch, "--trust",
               "--input", str(tmp_path / "net.toml"), "--store", str(store)]  # fmt: skip
    assert main(command) == 0
    assert main(["run", "add", "rgb", "--model", "rgb", "--store", str(store)]) == 0
    precompute(store, SilentReporter(), [], PrecomputeOptions(trust=True))
    with s2rstore.open(store) as opened:
        for side in ("sim", "real"):
            raw = outputs(network, files[side], load_for_imagenet)
            poses = poses_of(opened, "rgb", side)
            assert np.hypot(*(poses[:, :2] - raw[:, :2]).T).max() < 0.001
            turn = angle(poses[:, 2] - np.arctan2(raw[:, 3], raw[:, 2]))
            assert np.degrees(turn).max() < 0.1
        kinds = {record.kind for record in opened.array_kinds("rgb")}
    assert {"pixel_difference", "harmonised_difference", "map:pixel_difference"} <= kinds
    assert "occlusion" not in kinds
    assert check(store).damages == ()

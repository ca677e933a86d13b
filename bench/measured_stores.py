"""Generated stores for measurements."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from torch import Tensor, nn
from torch.nn import functional

from bench.index_store import frame_rows
from s2rstore.arrays import array_writer
from s2rstore.files import layout
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import IndexTransaction, edit
from s2rtools.datasets.writing.build import unlisted_checksums
from s2rtools.models import build_network
from s2rtools.models.conventions import OutputConvention
from s2rtools.models.model_registration import pack_weights, register_model
from s2rtools.models.pose_network import PoseNetwork
from s2rtools.precompute.run_registration import insert_run

SHARD = 64


class Small(PoseNetwork):
    """A network of one convolution, for measurements of everything but the network."""

    architecture: ClassVar[str] = "bench.measured_stores:Small"
    convention = OutputConvention("cos_sin")
    input_size = (16, 16)
    embedding_size = 512

    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.Conv2d(4, 32, 3, padding=1)
        self.out = nn.Linear(self.embedding_size, 4)

    @property
    def trunk(self) -> nn.Module:
        return self.conv

    def embed(self, features: Tensor) -> Tensor:
        return functional.adaptive_avg_pool2d(features, 4).flatten(1)

    def head(self, embedding: Tensor) -> Tensor:
        return self.out(embedding)


def frames_store(path: Path, n: int, size: int, network: PoseNetwork) -> Path:
    """A store with `n` instances of noise frames and one uncomputed run `r` of `network`."""
    path.mkdir(parents=True)
    rng = np.random.default_rng(0)
    with edit(path) as draft:
        _tables(draft, n, size)
        draft.insert("frame", frame_rows(n))
        register_model(path, draft, "m", pack_weights(network), network.convention)
        insert_run(draft, "r", "m", ("sim", "real"))
    block = _pictures(rng, min(n, SHARD), size)
    ledger = Ledger(path)
    for domain in ("sim", "real"):
        for image, rows in block.items():
            relative = Path(layout.FRAMES, domain, "t", image)
            array_writer.create(
                path / relative, array_writer.plan_layout(n, rows.shape[1:], "uint8", SHARD)
            )
            for shard in range(-(-n // SHARD)):
                count = min(SHARD, n - shard * SHARD)
                file = array_writer.write_shard(path / relative, shard, rows[:count])
                ledger.add(f"{relative}:{shard}", [(file.path, count)])
    with edit(path) as draft:
        draft.record_checksums(unlisted_checksums(path))
    return path


def _pictures(rng: np.random.Generator, count: int, size: int) -> dict[str, np.ndarray]:
    """Smooth images with a little noise, which compress about as well as photographs."""
    u, v = np.meshgrid(np.linspace(0, 6, size), np.linspace(0, 6, size))
    phase = rng.random((count, 1, 1, 3)) * 6
    waves = np.sin(u[None, :, :, None] + phase) + np.cos(v[None, :, :, None] * 2 + phase)
    rgb = 128 + 50 * waves + rng.normal(0, 3, waves.shape)
    depth = 100 + 60 * waves[..., 0]
    return {
        "rgb": np.clip(rgb, 0, 255).astype(np.uint8),
        "depth": np.clip(depth, 6, 249).astype(np.uint8),
    }


def _tables(draft: IndexTransaction, n: int, size: int) -> None:
    draft.insert_row(
        "dataset",
        {"name": "bench", "hash": f"{n:064d}", "bounds_x0": 0.0, "bounds_y0": 0.0,
         "bounds_x1": 20.0, "bounds_y1": 20.0, "y_down": True, "accuracy_scale": 26.0,
         "frame_height": size, "frame_width": size},
    )  # fmt: skip
    draft.insert_row("trajectory", {"trajectory": "t", "instances": n})
    camera = {"fx": size * 0.6, "fy": size * 0.6, "cx": size / 2, "cy": size / 2, "pitch": 0.0}
    for domain in ("sim", "real"):
        cameras = {f"{i}_{k}": v for i in ("rgb", "depth") for k, v in camera.items()}
        draft.insert_row(
            "domain",
            {"domain": domain, "kind": domain, **cameras, "camera_height": 0.6,
             "forward_offset": 0.0, "depth_scale": 10 / 255, "depth_raw_min": 6,
             "depth_raw_max": 249, "source": {}},
        )  # fmt: skip
    rng = np.random.default_rng(1)
    draft.insert(
        "instance",
        {"iid": np.arange(n, dtype=np.int32), "trajectory": np.full(n, "t", dtype=object),
         "seq": np.arange(n), "x": rng.random(n) * 20, "y": rng.random(n) * 20,
         "heading": rng.random(n) * 6 - 3, "curvature": rng.normal(0, 20, n)},
    )  # fmt: skip


def lively(architecture: str) -> PoseNetwork:
    """A network with random batch statistics, so that every layer has non-zero outputs."""
    import torch

    torch.manual_seed(0)
    network = build_network(architecture)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_var.uniform_(0.5, 1.5)
    return network.eval().requires_grad_(False)


class _Quiet:
    """A reporter that ignores progress."""

    def begin(self, what: str, total: int) -> None: ...
    def advance(self, steps: int) -> None: ...
    def say(self, line: str) -> None: ...


QUIET = _Quiet()

"""Depth that a run's adjustments make invalid is missing in its counterfactual views, too."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from s2rstore.geometry.camera_offset import UNCHANGED
from s2rtools.models.input_contract import InputContract
from s2rtools.scoring.counterfactual_errors import CounterfactualErrors

SIZE = (24, 24)
MISSING = 9.0


def test_depth_holes_of_a_run_are_missing_depth():
    metres = np.linspace(1, 5, 24, dtype=np.float32) * np.ones((1, *SIZE), dtype=np.float32)
    views = SimpleNamespace(rgb=np.zeros((1, *SIZE, 3), np.uint8), depth=metres)
    data = SimpleNamespace(
        severities=lambda side: {},
        camera=lambda side: SimpleNamespace(moved=lambda *move: None),
        sensed=lambda views, factors, numbers: views,
        raw_depth=lambda views: (1000 * views.depth).astype(np.uint16),
    )
    domain = SimpleNamespace(depth_raw_min=1, depth_raw_max=60000, depth_scale=0.001)
    truth = SimpleNamespace(
        data=data,
        camera_moves=lambda run: {"real": UNCHANGED},
        store=SimpleNamespace(domain=lambda name: domain, path=Path()),
    )
    run = SimpleNamespace(
        run="mine", real_domain="real", real_adjustments=[{"name": "depth_holes", "value": 0.2}]
    )
    inputs = []

    def forward_all(x: np.ndarray) -> SimpleNamespace:
        inputs.append(x)
        return SimpleNamespace(pose=np.zeros((len(x), 3)))

    contract = InputContract(
        "depth", SIZE, depth_unit=1.0, depth_mean=0.0, depth_std=1.0, missing_depth=MISSING
    )
    model = SimpleNamespace(contract=contract)
    network = SimpleNamespace(batch=8, model=model, forward_all=forward_all)
    errors = CounterfactualErrors(truth, [(run, network)])
    renderer = SimpleNamespace(render=lambda poses, camera: views)
    errors.of_views(renderer, np.zeros((1, 3)), np.zeros(1, dtype=np.intp))
    lost = inputs[0] == MISSING
    assert 0.1 < lost.mean() < 0.3
    assert not (inputs[0] == 0).any()

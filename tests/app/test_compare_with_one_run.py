"""The comparison of the only run: with its baseline, the constant prediction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.metrics import run_metrics
from s2rtui.app.pilot import snapshot
from s2rtui.canvas import RenderOptions
from s2rtui.charts.compare.model import constant_errors
from s2rtui.cli import main
from tests.support import tiny


@pytest.fixture(scope="module")
def one_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny.build(tmp_path_factory.mktemp("one") / "one.s2r", runs=("vanilla",))


def test_errors_of_the_constant_prediction_give_the_baseline_of_the_store(one_run: Path) -> None:
    with s2rstore.open(one_run) as store:
        truth, columns = store.instances, store.run_columns("vanilla")
        points = np.stack([truth.x, truth.y], axis=1)
        errors = constant_errors(points, columns.valid, columns.trained)
        accuracy = np.maximum(0, 1 - errors[columns.valid] / store.dataset.accuracy_scale)
        assert accuracy.mean() == pytest.approx(run_metrics.baseline_accuracy(store, "vanilla"))


def test_new_instances_alone_decide_the_constant_prediction() -> None:
    points = np.array([[0.0, 0.0], [2.0, 0.0], [8.0, 0.0], [np.nan, 0.0]])
    valid, trained = np.array([True, True, True, True]), np.array([False, False, True, False])
    assert constant_errors(points, valid, trained)[:3].tolist() == [1.0, 1.0, 7.0]
    assert constant_errors(points, valid, ~trained | trained)[:2].tolist() == pytest.approx(
        [10 / 3, 4 / 3]
    )


@pytest.mark.parametrize("size", [(60, 20), (200, 60)])
def test_one_run_is_compared_with_its_baseline(one_run: Path, size: tuple[int, int]) -> None:
    text = " ".join(snapshot(one_run, size, ["c", "9"], RenderOptions()).text.split())
    assert "real errors of the only run and of its constant baseline" in text
    if size[0] < 150:
        assert "Real errors of vanilla (A) and baseline (B): baseline is better on" in text
    assert "left hall" in text
    assert "better in baseline" in text or size[1] == 20


def test_the_figure_and_the_numbers_have_the_baseline_too(
    one_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figure = tmp_path / "figure.png"
    view = ["export", str(one_run), "--view", "compare", "--size", "600x400", "--out", str(figure)]
    assert main(view) == 0
    assert figure.stat().st_size > 1000
    assert main(["show", str(one_run), "compare", "--words"]) == 0
    assert "vanilla (A) and baseline (B)" in capsys.readouterr().out

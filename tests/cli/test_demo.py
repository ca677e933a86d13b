"""The demo command: full run, resumption after an interruption, and damaged recipes and scores."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rtools.scoring import factor_effects
from s2rtools.synthetic_world.dataset import WorldData
from s2rtools.synthetic_world.factors import FACTORS
from s2rtools.training import pretrained
from s2rtui.cli import main
from s2rtui.cli.commands import demo

pytestmark = pytest.mark.xdist_group("world")
DEMO_ARGUMENTS = ["demo", "--no-open", "--instances", "4", "--out"]


@pytest.fixture(scope="module")
def demo_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A demo that was interrupted after registering its models and then resumed."""
    out = tmp_path_factory.mktemp("demo")
    arguments = ["ingest", "world", "--instances", "4", "--store", str(out / "world.s2r")]
    assert main(arguments) == 0
    pretrained.add_pretrained_models(out / "world.s2r")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(factor_effects, "MAX_VIEWS", factor_effects.MIN_VIEWS)
        assert main([*DEMO_ARGUMENTS, str(out)]) == 0
    return out


def test_the_demo_prints_findings_and_writes_images(demo_folder: Path, capsys) -> None:
    assert main([*DEMO_ARGUMENTS, str(demo_folder)]) == 0
    output = capsys.readouterr()
    for expected in ("4 runs", "best run: ", "costliest factor of vanilla",
                 "best heatmap of vanilla: harmonised"):  # fmt: skip
        assert expected in output.out
    assert "s2r precompute" not in output.err
    for name in ("overview", "geomap", "instance", "screen"):
        assert (demo_folder / f"{name}.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    "arguments", [["--seed", "2"], ["--factors", "none"], ["--instances", "5"]]
)
def test_different_world_options_need_another_folder(
    demo_folder: Path, arguments: list[str], capsys
) -> None:
    assert main(["demo", "--no-open", *arguments, "--out", str(demo_folder)]) == 2
    assert arguments[0] in capsys.readouterr().err


def test_the_demo_lists_every_factor() -> None:
    assert tuple(FACTORS) == demo._FACTORS


@pytest.mark.parametrize("recipe", ["[]", "{", "null", '{"seed": "x"}', '{"moon": 1}',
                                    '{"frame": 64}', '{"factors": {"lights": 9}}'])  # fmt: skip
def test_a_damaged_recipe_is_reported(tiny_store: Path, tmp_path: Path, recipe: str) -> None:
    from s2rstore.errors import RequestError
    from tests.support.copies import copy_store

    path = copy_store(tiny_store, tmp_path / "x.s2r")
    with edit(path) as draft:
        draft.set_provenance("world", {"recipe": recipe})
    with (
        s2rstore.open(path) as store,
        pytest.raises(RequestError, match="recipe of the world is invalid"),
    ):
        WorldData.of_store(store)


@pytest.mark.parametrize("report", ["{", "[]", "null", json.dumps({"runs": {}, "factors": 3})])
def test_a_damaged_score_does_not_prevent_the_summary(
    tiny_store: Path, tmp_path: Path, report: str
) -> None:
    from s2rstore.findings import store_summary
    from tests.support.copies import copy_store

    path = copy_store(tiny_store, tmp_path / "x.s2r")
    with edit(path) as draft:
        draft.set_provenance("score", {"report": report})
    with s2rstore.open(path) as store:
        assert store_summary.summary_lines(store)

"""The demo command: full run, resumption after an interruption, and damaged recipes."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.schema import HEALTH
from s2rstore.index.transaction import edit
from s2rtools.synthetic_world.dataset import WorldData
from s2rtools.synthetic_world.factors import FACTORS
from s2rtui.cli import main
from s2rtui.cli.commands import demo
from s2rtui.jobs.background_demo import ChildCommand
from tests.support.copies import copy_store

DEMO_ARGUMENTS = ["demo", "--no-open", "--instances", "4", "--out"]


@pytest.fixture
def demo_folder(tmp_path: Path, tiny_store: Path) -> Path:
    """A folder with the small store as if it was a generated world."""
    path = copy_store(tiny_store, tmp_path / "demo" / "world.s2r")
    recipe = {"seed": 1, "count": 4, "factors": dict.fromkeys(FACTORS, 1.0)}
    with edit(path) as draft:
        draft.set_provenance("world", {"recipe": json.dumps(recipe)})
        draft.delete("provenance", what=HEALTH)
    return path.parent


class RecordedChild:
    """A child process that only runs `demo.main`."""

    def __init__(self, arguments: Sequence[str]) -> None:
        self._code = demo.main(list(arguments))

    def wait(self) -> int:
        return self._code

    def stop(self) -> None:
        pass


def test_stages_are_run_until_the_store_is_complete(demo_folder, capsys, monkeypatch):
    commands: list[str] = []
    path = demo_folder / "world.s2r"
    hidden = path.rename(demo_folder / "hidden")

    def record(words: list[str]) -> int:
        if words[0] in ("export", "snapshot"):
            return main(words)
        commands.append(words[0])
        if words[0] == "ingest":
            hidden.rename(path)
        return 3 if words[0] == "suggest" else 0  # 3: nothing helps

    monkeypatch.setattr(demo, "main", record)
    monkeypatch.setattr(demo, "ChildCommand", RecordedChild)
    assert main([*DEMO_ARGUMENTS, str(demo_folder)]) == 0
    assert commands == ["ingest", "precompute", "score", "check", "suggest"]
    output = capsys.readouterr()
    assert "2 runs" in output.out
    assert f"open it with: s2r {path}" in output.out
    for name in ("overview", "geomap", "instance", "screen"):
        assert (demo_folder / f"{name}.png").stat().st_size > 10_000
    with s2rstore.open(path) as store:
        keys = {name: run.key for name, run in store.runs.items()}
    with edit(path) as draft:
        draft.set_provenance("score", {"report": json.dumps({"runs": keys})})
        draft.delete("run", run="vanilla")
        draft.set_provenance(HEALTH, {"real": "4"})
    del commands[:]
    assert main([*DEMO_ARGUMENTS, str(demo_folder)]) == 0
    assert commands == ["model", "suggest"]


def test_the_output_and_the_end_of_a_child_command_are_shown(tiny_store, tmp_path, capsys):
    child = ChildCommand(["runs", str(tiny_store)])
    assert child.wait() == 0
    assert "vanilla" in capsys.readouterr().err
    child.stop()
    child = ChildCommand(["runs", str(tmp_path / "none.s2r")])
    assert child.wait() == 2
    child.stop()
    child = ChildCommand(["runs", str(tiny_store)])
    child._process.kill()
    assert child.wait() == 70
    assert "s2r runs was ended by signal SIGKILL" in capsys.readouterr().err


def test_different_world_options_need_another_folder(demo_folder, s2r):
    for option, value in (("--seed", "2"), ("--factors", "none"), ("--instances", "5")):
        s2r("demo", "--no-open", option, value, "--out", demo_folder).assert_refused(option)


def test_the_demo_lists_every_factor():
    assert tuple(FACTORS) == demo._FACTORS


def test_a_damaged_recipe_is_reported(store_copy):
    for recipe in ("[]", "{", "null", '{"seed": "x"}', '{"moon": 1}', '{"frame": 64}',
                   '{"factors": {"lights": 9}}'):  # fmt: skip
        with edit(store_copy) as draft:
            draft.set_provenance("world", {"recipe": recipe})
        with (
            s2rstore.open(store_copy) as store,
            pytest.raises(RequestError, match="recipe of the world is invalid"),
        ):
            WorldData.of_store(store)

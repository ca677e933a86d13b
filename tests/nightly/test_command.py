"""`s2r nightly`: what it asks of the gate, what it says, and its exit code."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import s2rtools.gap
from s2rtools.nightly.config import Config
from s2rtui.cli import main
from tests.support import nights


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The gate's place, taken by one that answers with the G that a test sets."""
    seen = SimpleNamespace(gaps={"task": 5.0}, requests=[], count=0)

    def measured_report(evidence: Any, request: Any) -> dict[str, Any]:
        seen.count += 1
        return nights.report(evidence, seen.gaps)

    def request(*given: Any) -> tuple[Any, ...]:
        seen.requests.append(given)
        return given

    gate = SimpleNamespace(
        Request=request, evidence=lambda store, request: store, measured_report=measured_report
    )
    monkeypatch.setitem(sys.modules, "s2rtools.gap.gate", gate)
    monkeypatch.setattr(s2rtools.gap, "gate", gate, raising=False)
    return seen


def command(config: Config, *words: str) -> int:
    return main(["nightly", str(config.source), "--night", "2026-11-21", *words])


@pytest.mark.parametrize(("gap", "code", "word"), [(5, 0, "PASS"), (15, 3, "INCONCLUSIVE"),
                                                   (40, 1, "FAIL")])  # fmt: skip
def test_the_exit_code_is_the_gates(
    config: Config, asked: SimpleNamespace, capsys, gap: float, code: int, word: str
) -> None:
    asked.gaps = {"task": float(gap)}
    assert command(config) == code
    told = capsys.readouterr().out
    assert told.startswith(f"{word:<12}  headline: G {gap}.0")
    assert f"2026-11-21: {word}; reports in {config.reports / '2026-11-21'}" in told


def test_the_same_night_says_that_nothing_is_new(
    config: Config, asked: SimpleNamespace, capsys
) -> None:
    assert command(config) == 0
    assert "nothing new" not in capsys.readouterr().err
    assert command(config) == 0
    assert capsys.readouterr().err == "nothing new\n"
    words = ["nightly", str(config.source), "--night", "2026-11-22"]
    assert main(words) == 0
    assert "figures are those of an earlier night" in capsys.readouterr().err
    assert asked.count == 1


def test_json_tells_all_that_a_script_needs(config: Config, asked: SimpleNamespace, capsys) -> None:
    asked.gaps = {"visual": 3.0, "task": 40.0}
    assert command(config, "--json") == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["outcome"], found["exit_code"], found["worst"]) == ("FAIL", 1, "task")
    assert (found["gap"], found["gap_low"], found["gap_high"]) == (40.0, 38.0, 42.0)
    assert (found["new"], found["computed"], found["stale"]) == (True, True, False)
    assert Path(found["reports"], "junit.xml").is_file()
    assert Path(found["metrics"]).is_file()
    assert Path(found["history"]).is_file()


def test_the_gate_is_asked_what_the_configuration_says(
    config: Config, asked: SimpleNamespace
) -> None:
    text = config.source.read_text().replace(
        "[drives]", 'run = "vanilla"\nselect = "worst15"\naxes = ["task"]\nthreshold = 20\n'
        "margin = 0.1\nseed = 4\nreplicates = 200\n[drives]", 1,
    )  # fmt: skip
    config.source.write_text(text)
    command(config)
    run, select, axes, drives, features, reference, golden, *numbers, settings = asked.requests[0]
    assert (run, select, axes) == ("vanilla", "worst15", ("task",))
    assert drives == str(config.source.parent / "drives")
    assert (features, reference, golden, numbers) == (None, None, None, [20.0, 0.1])
    assert (settings.replicates, settings.seed) == (200, 4)


def test_without_a_night_it_is_today(config: Config, asked: SimpleNamespace, capsys) -> None:
    import datetime

    before = datetime.datetime.now(datetime.UTC).date()
    assert main(["nightly", str(config.source), "--json"]) == 0
    night = datetime.date.fromisoformat(json.loads(capsys.readouterr().out)["night"])
    assert before <= night <= datetime.datetime.now(datetime.UTC).date()


def test_identification_that_is_not_installed_is_named(
    config: Config, asked: SimpleNamespace, capsys, monkeypatch
) -> None:
    monkeypatch.setitem(sys.modules, "s2rtools.sysid.nightly", None)
    (config.source.parent / "robot.toml").write_text("damping = [0, 2]\n")
    with config.source.open("a") as file:
        file.write('[sysid]\nsimulator = "planar"\nparameters = "robot.toml"\n')
    assert command(config) == 2
    assert "[sysid]: needs s2rtools.sysid" in capsys.readouterr().err
    assert not config.history.exists()

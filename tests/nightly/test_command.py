"""`s2r nightly`: what it asks of the gate, what it says, and its exit code."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import s2rtools.gap.gate
from s2rstore.gap_history import reader as stored
from s2rtools.nightly.config import NightlyConfig
from s2rtui.cli import main
from tests.support import nights


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The gate's place, taken by one that answers with the G that a test sets."""
    seen = SimpleNamespace(gaps={"task": 5.0}, requests=[], count=0)

    def measured_report(evidence: Any, request: Any) -> dict[str, Any]:
        seen.count += 1
        return nights.report(evidence, seen.gaps)

    def request(**given: Any) -> dict[str, Any]:
        seen.requests.append(given)
        return given

    gate = SimpleNamespace(
        GapRequest=request,
        collect_evidence=lambda store, request: store,
        measured_report=measured_report,
    )
    monkeypatch.setitem(sys.modules, "s2rtools.gap.gate.gate", gate)
    monkeypatch.setattr(s2rtools.gap.gate, "gate", gate, raising=False)
    return seen


def command(config: NightlyConfig, *words: str) -> int:
    return main(["nightly", str(config.source), "--night", "2026-11-21", *words])


@pytest.mark.parametrize(("gap", "code", "word"), [(5, 0, "PASS"), (15, 3, "INCONCLUSIVE"),
                                                   (40, 1, "FAIL")])  # fmt: skip
def test_the_exit_code_is_the_gates(
    config: NightlyConfig, asked: SimpleNamespace, capsys, gap: float, code: int, word: str
) -> None:
    asked.gaps = {"task": float(gap)}
    assert command(config) == code
    told = capsys.readouterr().out
    assert told.startswith(f"{word:<12}  headline: G {gap}.0")
    assert f"2026-11-21: {word}; reports in {config.reports / '2026-11-21'}" in told


def test_the_same_night_says_that_nothing_is_new(
    config: NightlyConfig, asked: SimpleNamespace, capsys
) -> None:
    assert command(config) == 0
    assert "no new" not in capsys.readouterr().err
    assert command(config) == 0
    told = "no new evidence: the night is in the history already\n"
    assert capsys.readouterr().err == told
    words = ["nightly", str(config.source), "--night", "2026-11-22"]
    assert main(words) == 0
    assert "figures are those of an earlier night" in capsys.readouterr().err
    assert asked.count == 1


def test_json_tells_all_that_a_script_needs(
    config: NightlyConfig, asked: SimpleNamespace, capsys
) -> None:
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
    config: NightlyConfig, asked: SimpleNamespace
) -> None:
    text = config.source.read_text().replace(
        "[drives]", 'run = "vanilla"\nselect = "worst15"\naxes = ["task"]\nthreshold = 20\n'
        "margin = 0.1\nseed = 4\nreplicates = 200\n[drives]\ndynamics = [\"reach=2\"]", 1,
    )  # fmt: skip
    config.source.write_text(text)
    command(config)
    (given,) = asked.requests
    settings = given.pop("settings")
    assert (settings.replicates, settings.seed) == (200, 4)
    assert given == {
        "run": "vanilla", "expression": "worst15", "axes": ("task",), "rate": None,
        "drives": str(config.source.parent / "drives"), "features": None, "reference": None,
        "topic": None, "golden": None, "threshold": 20.0, "margin": 0.1,
        "dynamics": ("reach=2",),
    }  # fmt: skip


def test_without_a_night_it_is_today(config: NightlyConfig, asked: SimpleNamespace, capsys) -> None:
    import datetime

    before = datetime.datetime.now(datetime.UTC).date()
    assert main(["nightly", str(config.source), "--json"]) == 0
    night = datetime.date.fromisoformat(json.loads(capsys.readouterr().out)["night"])
    assert before <= night <= datetime.datetime.now(datetime.UTC).date()


def test_drives_that_are_too_few_for_an_identification_are_told(
    config: NightlyConfig, asked: SimpleNamespace, capsys
) -> None:
    from s2rtools.sysid import Recording, make_drives

    drives = config.source.parent / "few"
    make_drives(drives, 1, recording=Recording(count=2, seconds=3.0))
    with config.source.open("a") as file:
        file.write('[sysid]\ndrives = "few"\n')
    assert command(config) == 0
    (row,) = stored.read(config.history).of_configuration("lab")[0].estimates
    assert row.parameter == "planar"
    assert "not identified: 2 drives" in str(row.note)
    assert "planar" in (config.reports / "2026-11-21" / "report.md").read_text()


def test_the_simulator_is_identified_from_drives(
    config: NightlyConfig, asked: SimpleNamespace
) -> None:
    from s2rtools.sysid import Recording, make_drives

    drives = config.source.parent / "made"
    make_drives(drives, 1, {"damping": 0.5}, Recording(count=6, seconds=6.0))
    truth = json.loads((drives / "truth.json").read_text())["values"]
    with config.source.open("a") as file:
        file.write('[sysid]\ndrives = "made"\nparameters = ["damping"]\nseeds = 1\n')
    assert command(config) == 0
    found = {each.parameter: each for each in stored.read(config.history).nights[0].estimates}
    assert set(found) == {"damping", "latency"}
    assert found["damping"].value.value == pytest.approx(truth["damping"], rel=0.1)
    assert found["damping"].value.low < truth["damping"] < found["damping"].value.high
    assert config.metrics is not None
    assert 's2r_gap_estimate{dataset="tiny",nightly="lab",parameter="damping"' in (
        config.metrics.read_text()
    )


def test_bags_are_read_by_the_topic_that_is_named(
    config: NightlyConfig, asked: SimpleNamespace
) -> None:
    text = config.source.read_text()
    config.source.write_text(text.replace("[drives]\n", '[drives]\ntopic = "/odom"\n', 1))
    command(config)
    assert asked.requests[0]["topic"] == "/odom"


def test_what_an_identification_warns_of_is_told(
    config: NightlyConfig, asked: SimpleNamespace
) -> None:
    from s2rtools.sysid import Recording, make_drives

    drives = config.source.parent / "made"
    make_drives(drives, 1, {"latency": 0.8, "wheels": 1.0}, Recording(count=6, seconds=6.0))
    with config.source.open("a") as file:
        file.write('[sysid]\ndrives = "made"\nparameters = ["damping"]\nseeds = 1\n'
                   'range = { latency = "0..0.05" }\n')  # fmt: skip
    assert command(config) == 0
    notes = {each.parameter: each.note for each in stored.read(config.history).nights[0].estimates}
    assert notes["latency"] == "at the end of its range"
    assert "end of the range 0 .. 0.05 s" in notes["planar"]
    assert "structural mismatch: wheels = " in notes["planar"]
    told = (config.reports / "2026-11-21" / "report.html").read_text()
    assert "structural mismatch: wheels = " in told

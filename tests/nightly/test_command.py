"""`s2r nightly`: requests to the gate, output and exit code."""

from __future__ import annotations

import datetime
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from s2rstore.gap_history import reader as stored
from s2rstore.gap_history.change_check import YEAR_LEVEL
from s2rtools.gap.axis import GapSettings
from s2rtools.gap.gate import gate
from s2rtools.gap.gate.gate import GapRequest
from s2rtools.nightly.config import NightlyConfig
from s2rtools.sysid.synthetic_drives import Recording, make_drives
from s2rtui.cli import main
from tests.support import nights

pytestmark = pytest.mark.usefixtures("constant_plot")


@pytest.fixture
def fake_gate(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Replaces the gate by one that returns the gaps set by the test."""
    recorded = SimpleNamespace(gaps={"task": 5.0}, requests=[], count=0)

    def measured_report(evidence: Any, request: Any) -> dict[str, Any]:
        recorded.count += 1
        return nights.report(evidence, recorded.gaps)

    def collect_evidence(store: Any, request: GapRequest) -> Any:
        recorded.requests.append(request)
        return store

    monkeypatch.setattr(gate, "collect_evidence", collect_evidence)
    monkeypatch.setattr(gate, "measured_report", measured_report)
    return recorded


def command(config: NightlyConfig, *arguments: str) -> int:
    return main(["nightly", str(config.source), "--night", "2026-11-21", *arguments])


@pytest.mark.parametrize(("gap", "code", "outcome"), [(5, 0, "PASS"), (15, 3, "INCONCLUSIVE"),
                                                   (40, 1, "FAIL")])  # fmt: skip
def test_the_exit_code_is_that_of_the_gate(config, fake_gate, capsys, gap, code, outcome):
    fake_gate.gaps = {"task": float(gap)}
    assert command(config) == code
    output = capsys.readouterr().out
    assert output.startswith(f"{outcome:<12}  headline: G {gap}.0")
    assert f"2026-11-21: {outcome}; reports in {config.reports / '2026-11-21'}" in output


def test_a_repeated_night_reports_no_new_evidence(config, fake_gate, capsys):
    assert command(config) == 0
    assert "no new" not in capsys.readouterr().err
    assert command(config) == 0
    output = "no new evidence: the night is in the history already\n"
    assert capsys.readouterr().err == output
    arguments = ["nightly", str(config.source), "--night", "2026-11-22"]
    assert main(arguments) == 0
    assert "figures are those of an earlier night" in capsys.readouterr().err
    assert fake_gate.count == 1


def test_json_output_contains_the_outcome(config, fake_gate, capsys):
    fake_gate.gaps = {"visual": 3.0, "task": 40.0}
    assert command(config, "--json") == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["outcome"], result["exit_code"], result["worst"]) == ("FAIL", 1, "task")
    assert (result["gap"], result["gap_low"], result["gap_high"]) == (40.0, 38.0, 42.0)
    assert (result["new"], result["computed"], result["stale"]) == (True, True, False)
    assert Path(result["reports"], "junit.xml").is_file()
    assert Path(result["metrics"]).is_file()
    assert Path(result["history"]).is_file()


def test_the_configuration_is_passed_to_the_gate(config, fake_gate):
    text = config.source.read_text().replace(
        "[drives]", 'run = "vanilla"\nselect = "worst15"\naxes = ["task"]\nthreshold = 20\n'
        "margin = 0.1\nseed = 4\n[drives]\ntopic = \"/odom\"\n"
        "dynamics = [\"reach=2\"]", 1,
    )  # fmt: skip
    config.source.write_text(text)
    command(config)
    (request,) = fake_gate.requests
    assert request == GapRequest(
        run="vanilla", expression="worst15", axes=("task",), topic="/odom", threshold=20.0,
        drives=str(config.source.parent / "drives"), margin=0.1, options={"reach": "2"},
        settings=GapSettings(fail_level=YEAR_LEVEL, seed=4),
    )  # fmt: skip


def test_the_default_night_is_today(config, fake_gate, capsys):
    before = datetime.datetime.now(datetime.UTC).date()
    assert main(["nightly", str(config.source), "--json"]) == 0
    night = datetime.date.fromisoformat(json.loads(capsys.readouterr().out)["night"])
    assert before <= night <= datetime.datetime.now(datetime.UTC).date()


def test_too_few_drives_for_an_identification_are_reported(config, fake_gate, capsys):
    drives = config.source.parent / "few"
    make_drives(drives, 1, recording=Recording(count=2, seconds=3.0))
    with config.source.open("a") as file:
        file.write('[sysid]\ndrives = "few"\n')
    assert command(config) == 0
    (row,) = stored.read(config.history).of_configuration("lab")[0].estimates
    assert row.parameter == "planar"
    assert "not identified: 2 drives" in str(row.note)
    assert "planar" in (config.reports / "2026-11-21" / "report.md").read_text()


def test_the_simulator_is_identified_from_drives(config, fake_gate):
    drives = config.source.parent / "made"
    make_drives(drives, 1, {"damping": 0.5}, Recording(count=6, seconds=6.0))
    truth = json.loads((drives / "truth.json").read_text())["values"]
    with config.source.open("a") as file:
        file.write('[sysid]\ndrives = "made"\nparameters = ["damping"]\nseeds = 1\n')
    assert command(config) == 0
    estimates = {e.parameter: e for e in stored.read(config.history).nights[0].estimates}
    assert set(estimates) == {"damping", "latency"}
    assert estimates["damping"].value.value == pytest.approx(truth["damping"], rel=0.1)
    assert estimates["damping"].value.low < truth["damping"] < estimates["damping"].value.high
    estimate = 's2r_gap_estimate{dataset="tiny",nightly="lab",parameter="damping"'
    assert estimate in config.metrics.read_text()


def test_warnings_of_an_identification_are_reported(config, fake_gate):
    drives = config.source.parent / "made"
    make_drives(drives, 1, {"latency": 0.8, "wheels": 1.0}, Recording(count=8, seconds=9.0))
    with config.source.open("a") as file:
        file.write('[sysid]\ndrives = "made"\nparameters = ["damping"]\nseeds = 1\n'
                   'range = { latency = "0..0.05" }\n')  # fmt: skip
    assert command(config) == 0
    notes = {e.parameter: e.note for e in stored.read(config.history).nights[0].estimates}
    assert notes["latency"] == "at the end of its range"
    assert "end of the range 0 .. 0.05 s" in notes["planar"]
    assert "structural mismatch: wheels = " in notes["planar"]
    html = (config.reports / "2026-11-21" / "report.html").read_text()
    assert "structural mismatch: wheels = " in html

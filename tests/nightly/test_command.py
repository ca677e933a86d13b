"""`s2r nightly`: output and exit code, and nights on ROS bags with several topics."""

from __future__ import annotations

import datetime
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.support import robot
from s2rstore.gap_history import reader as stored
from s2rtools.gap.gate import gate
from s2rtools.motion_logs import csv_reader
from s2rtools.nightly.config import NightlyConfig
from s2rtools.sysid.synthetic_drives import DriveSettings, make_drives
from s2rtui.cli import main
from tests.support import nights
from tests.support.bags import ODOMETRY, POSE, write

pytestmark = pytest.mark.usefixtures("constant_plot")


@pytest.fixture
def fake_gate(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Replaces the gate by one that returns the gaps set by the test."""
    recorded = SimpleNamespace(gaps={"task": 5.0}, count=0)

    def measured_report(evidence: Any, request: Any) -> dict[str, Any]:
        recorded.count += 1
        return nights.report(evidence, recorded.gaps)

    monkeypatch.setattr(gate, "collect_evidence", lambda store, request: store)
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


def test_the_default_night_is_today(config, fake_gate, capsys):
    before = datetime.datetime.now(datetime.UTC).date()
    assert main(["nightly", str(config.source), "--json"]) == 0
    night = datetime.date.fromisoformat(json.loads(capsys.readouterr().out)["night"])
    assert before <= night <= datetime.datetime.now(datetime.UTC).date()


def test_the_simulator_is_identified_from_drives(config, fake_gate):
    drives = config.source.parent / "made"
    make_drives(drives, 1, {"damping": 0.5}, DriveSettings(count=6, seconds=6.0))
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
    make_drives(drives, 1, {"latency": 0.8, "wheels": 1.0}, DriveSettings(count=8, seconds=9.0))
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


@pytest.fixture
def bag_folder(config: NightlyConfig) -> Path:
    """A drive whose bags contain its poses as /truth and a standing robot as /odom."""
    commands = robot.commands(8.0, np.random.default_rng(3))
    real = robot.sampled(robot.drive(commands, delay=0.1), 10.0)
    sim = robot.sampled(robot.drive(commands), 10.0)
    folder = config.source.parent / "bags" / "one"
    folder.mkdir(parents=True)
    csv_reader.write_commands(commands, folder / "commands.csv")
    for role, log in (("real", real), ("sim", sim)):
        standing = replace(log, x=0 * log.x, y=0 * log.y, heading=0 * log.heading)
        write(folder / f"{role}.bag", {"/truth": (POSE, log), "/odom": (ODOMETRY, standing)})
    return folder.parent


def run_night(config: NightlyConfig, drives: str) -> int:
    """Run the delay axis and the identification."""
    config.source.write_text(
        f'store = "{config.store}"\naxes = ["delay"]\n[drives]\n{drives}\n'
        '[sysid]\nseeds = 1\n[output]\nreports = "reports"\n'
    )
    return main(["nightly", str(config.source), "--night", "2026-11-21"])


def test_the_named_topic_is_measured(config, bag_folder):
    assert run_night(config, f'folder = "{bag_folder}"\ntopic = "/truth"') == 3
    folder = config.reports / "2026-11-21"
    (delay,) = json.loads((folder / "report.json").read_text())["axes"]
    assert delay["details"]["delay"] == pytest.approx(0.1, abs=0.02)
    assert "not identified: 1 drive" in (folder / "report.md").read_text()


@pytest.mark.parametrize(
    ("topic", "expected", "code"),
    [("", "name one of /odom, /truth", 2), ('topic = "/pose"', "no topic /pose (has: /odom", 2),
     ('topic = "/odom"', "the motion never changes", 3)],
)  # fmt: skip
def test_missing_and_unusable_topics_are_reported(
    config, bag_folder, capsys, topic, expected, code
):
    assert run_night(config, f'folder = "{bag_folder}"\n{topic}') == code
    captured = capsys.readouterr()
    assert expected in captured.out + captured.err

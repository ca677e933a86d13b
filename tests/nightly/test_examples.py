"""The example files are valid for the programs that read them and match this version."""

from __future__ import annotations

import configparser
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from s2rstore.gap_history import reader
from s2rtools.gap.axes import AXES
from s2rtools.nightly import config
from s2rtools.nightly.report_files import metrics
from s2rtui.cli.command_parser import build_parser
from tests.nightly.test_files import samples

EXAMPLES = Path(__file__).parents[2] / "examples"
_SELECTOR = re.compile(r"(s2r_\w+)(?:\{([^}]*)\})?")
_LABEL = re.compile(r'(\w+)="([^"]*)"')


def test_the_example_configuration_is_valid(tmp_path):
    path = tmp_path / "nightly.toml"
    text = (EXAMPLES / "nightly.toml").read_text()
    for name in ("lab.s2r", "drives"):
        (tmp_path / name).mkdir()
    for name in ("reference.json", "golden.json", "inception.toml"):
        (tmp_path / name).write_text("{}")
    path.write_text(text)
    parsed = config.read(path)
    assert parsed.name == "lab"
    assert parsed.request.axes == tuple(AXES)
    assert parsed.metrics == (tmp_path / "metrics/s2r_gap.prom").resolve()
    path.write_text(re.sub(r"^# (?=[\[a-z])", "", text.partition("\n")[2], flags=re.M))
    with_all_keys = config.read(path)
    assert with_all_keys.sysid is not None
    assert with_all_keys.sysid.parameters == ("mass", "friction", "damping")
    assert with_all_keys.request.features == (tmp_path / "inception.toml").resolve()


def dashboard() -> dict[str, Any]:
    return json.loads((EXAMPLES / "grafana-dashboard.json").read_text())


def expressions() -> list[str]:
    return [target["expr"] for panel in dashboard()["panels"] for target in panel["targets"]]


def test_every_metric_of_the_dashboard_exists_with_its_labels(recorded_week):
    night = reader.read(recorded_week.config.history).of_configuration("lab")[-1]
    scraped = samples(metrics(night).decode())
    known_metrics = {name for name, _ in scraped}
    dashboard_json = dashboard()
    queries = [variable["query"] for variable in dashboard_json["templating"]["list"]]
    used_metrics = {name for text in (*expressions(), *queries)
                    for name, _ in _SELECTOR.findall(text)}  # fmt: skip
    assert used_metrics <= known_metrics
    for name in ("s2r_gap", "s2r_gap_threshold", "s2r_gap_outcome", "s2r_gap_estimate",
                 "s2r_gap_evidence_age_days"):  # fmt: skip
        assert name in used_metrics
    for name, labels in _SELECTOR.findall(" ".join(expressions())):
        for variable, value in (("nightly", "lab"), ("run", "vanilla"), ("axis", "task")):
            labels = labels.replace(f"${variable}", value)
        wanted = set(_LABEL.findall(labels))
        assert any(name == other and wanted <= found for other, found in scraped), labels


def test_the_dashboard_is_well_formed():
    dashboard_json = dashboard()
    panels = dashboard_json["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    variables = {variable["name"] for variable in dashboard_json["templating"]["list"]}
    cells: set[tuple[int, int]] = set()
    for panel in panels:
        position = panel["gridPos"]
        assert 0 <= position["x"] <= 24 - position["w"]
        columns = range(position["x"], position["x"] + position["w"])
        panel_cells = {(x, position["y"] + y) for x in columns for y in range(position["h"])}
        assert not panel_cells & cells
        cells |= panel_cells
        for target in panel["targets"]:
            assert set(re.findall(r"\$(\w+)", target["expr"])) <= variables
            assert target["expr"].count("(") == target["expr"].count(")")
        refs = [target["refId"] for target in panel["targets"]]
        assert len(set(refs)) == len(refs)


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="no systemd")
def test_systemd_verifies_the_units():
    units = [str(EXAMPLES / f"s2r-nightly.{kind}") for kind in ("service", "timer")]
    process = subprocess.run(["systemd-analyze", "verify", "--man=no", *units],
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert (process.returncode, process.stderr) == (0, "")


def unit(kind: str) -> configparser.ConfigParser:
    parsed = configparser.ConfigParser(interpolation=None, strict=True)
    parsed.optionxform = str  # type: ignore[method-assign, assignment]
    parsed.read(EXAMPLES / f"s2r-nightly.{kind}")
    return parsed


def arguments(command: str) -> list[str]:
    """The arguments after `s2r` in a command line."""
    parts = shlex.split(command)
    return parts[next(index for index, part in enumerate(parts) if Path(part).name == "s2r") + 1 :]


def test_the_timer_starts_the_service_and_the_service_runs_s2r_nightly():
    service, timer = unit("service"), unit("timer")
    assert timer["Timer"]["Unit"] == "s2r-nightly.service"
    assert timer["Timer"]["Persistent"] == "true"
    assert re.fullmatch(r"\*-\*-\* \d\d:\d\d:\d\d UTC", timer["Timer"]["OnCalendar"])
    assert service["Service"]["Type"] == "oneshot"
    assert service["Service"]["SuccessExitStatus"] == "3"
    _check_nightly_arguments(arguments(service["Service"]["ExecStart"]))


def test_the_scrontab_example_is_valid():
    lines = (EXAMPLES / "s2r-nightly.scrontab").read_text().splitlines()
    options = [line for line in lines if line.startswith("#SCRON")]
    assert all(re.fullmatch(r"#SCRON --[a-z-]+=\S+", line) for line in options)
    (entry,) = [line for line in lines if line and not line.startswith("#")]
    assert lines[-1] == entry
    *times, command = entry.split(maxsplit=5)
    bounds = ((0, 59), (0, 23), (1, 31), (1, 12), (0, 7))
    for time, (low, high) in zip(times, bounds, strict=True):
        assert time == "*" or low <= int(time) <= high
    _check_nightly_arguments(arguments(command))


def test_the_workflow_runs_the_gate_and_uploads_its_reports():
    yaml = pytest.importorskip("ruamel.yaml")
    parsed = yaml.YAML(typ="safe", pure=True).load((EXAMPLES / "github-actions.yml").read_text())
    assert set(parsed["on"]) == {"pull_request", "schedule"}
    (job,) = parsed["jobs"].values()
    steps = job["steps"]
    runs = [step["run"].strip().splitlines()[-1] for step in steps if "run" in step]
    command_arguments = [arguments(run) for run in runs if Path(run.split()[0]).name == "s2r"]
    assert [command[0] for command in command_arguments] == ["gap", "nightly"]
    assert {"--reference", "--golden", "--out"} <= set(command_arguments[0])
    _check_nightly_arguments(command_arguments[1])
    upload = next(step for step in steps if "upload-artifact" in step.get("uses", ""))
    assert upload["if"] == "${{ !cancelled() }}"
    assert "reports/latest/junit.xml" in upload["with"]["path"].split()


def _check_nightly_arguments(arguments: list[str]) -> None:
    options = build_parser(["nightly"]).parse_args(arguments)
    assert options.config.name == "nightly.toml"

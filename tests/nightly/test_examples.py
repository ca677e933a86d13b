"""The examples: each is parsed by what will read it, and fits what the program does."""

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
from s2rtools.nightly.metrics import metrics
from s2rtui.cli.command_parser import build_parser
from tests.nightly.test_files import Samples, samples
from tests.support.nights import Week

EXAMPLES = Path(__file__).parents[2] / "examples"
_SELECTOR = re.compile(r"(s2r_\w+)(?:\{([^}]*)\})?")
_LABEL = re.compile(r'(\w+)="([^"]*)"')


def test_the_sample_configuration_is_read(tmp_path: Path) -> None:
    path = tmp_path / "nightly.toml"
    text = (EXAMPLES / "nightly.toml").read_text()
    for name in ("lab.s2r", "drives"):
        (tmp_path / name).mkdir()
    for name in ("reference.json", "golden.json", "inception.toml"):
        (tmp_path / name).write_text("{}")
    path.write_text(text)
    found = config.read(path)
    assert found.name == "lab"
    assert found.axes == tuple(AXES)
    assert found.metrics == (tmp_path / "metrics/s2r_gap.prom").resolve()
    path.write_text(re.sub(r"^# (?=[\[a-z])", "", text.partition("\n")[2], flags=re.M))
    everything = config.read(path)
    assert everything.sysid is not None
    assert everything.sysid.parameters == ("mass", "friction", "damping")
    assert everything.features == (tmp_path / "inception.toml").resolve()


def dashboard() -> dict[str, Any]:
    return json.loads((EXAMPLES / "grafana-dashboard.json").read_text())


def expressions() -> list[str]:
    return [target["expr"] for panel in dashboard()["panels"] for target in panel["targets"]]


def test_every_metric_of_the_dashboard_exists(told_week: Week) -> None:
    night = reader.read(told_week.config.history).of_configuration("lab")[-1]
    text = metrics(night).decode()
    known = {name for name, _ in samples(text)}
    board = dashboard()
    queries = [variable["query"] for variable in board["templating"]["list"]]
    used = {name for text in (*expressions(), *queries) for name, _ in _SELECTOR.findall(text)}
    assert used <= known
    for name in ("s2r_gap", "s2r_gap_threshold", "s2r_gap_outcome", "s2r_gap_estimate",
                 "s2r_gap_evidence_age_days"):  # fmt: skip
        assert name in used


def test_the_dashboard_is_well_formed() -> None:
    board = dashboard()
    panels = board["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    variables = {variable["name"] for variable in board["templating"]["list"]}
    cells: set[tuple[int, int]] = set()
    for panel in panels:
        place = panel["gridPos"]
        assert 0 <= place["x"] <= 24 - place["w"]
        mine = {
            (place["x"] + x, place["y"] + y) for x in range(place["w"]) for y in range(place["h"])
        }
        assert not mine & cells
        cells |= mine
        for target in panel["targets"]:
            assert set(re.findall(r"\$(\w+)", target["expr"])) <= variables
            assert target["expr"].count("(") == target["expr"].count(")")
        refs = [target["refId"] for target in panel["targets"]]
        assert len(set(refs)) == len(refs)


def evaluated(expression: str, found: Samples, now: float, axis: str = "task") -> dict[str, float]:
    """The dashboard's kind of PromQL on one scrape: a selector, compared or in arithmetic."""
    for name, value in (("nightly", "lab"), ("run", "vanilla"), ("axis", axis)):
        expression = expression.replace(f"${name}", value)
    selector = _SELECTOR.search(expression)
    assert selector is not None
    wanted = set(_LABEL.findall(selector[2] or ""))
    result = {}
    for (name, labels), value in found.items():
        if name == selector[1] and wanted <= labels:
            rest = expression.replace(selector[0], repr(value)).replace("time()", repr(now))
            assert re.fullmatch(r"[\d.e+\-*/()= ]+", rest), rest
            if "==" in rest:
                left, right = rest.split("==")
                if float(left) != float(right):
                    continue
                rest = left
            names = dict(labels)
            key = names.get("outcome") or names.get("axis") or names.get("parameter") or name
            result[key] = eval(rest)
    return result


def test_the_dashboard_turns_red_on_day_five(told_week: Week) -> None:
    by_title = {panel["title"]: [t["expr"] for t in panel["targets"]]
                for panel in dashboard()["panels"]}  # fmt: skip
    for number, night in enumerate(
        reader.read(told_week.config.history).of_configuration("lab"), 1
    ):
        read, red = samples(metrics(night).decode()), number >= 5
        now = night.night.toordinal() * 86400.0 - 719163 * 86400.0 + 3 * 3600

        def shown(title: str, target: int = 0, read: Samples = read, now: float = now
                  ) -> dict[str, float]:  # fmt: skip
            return evaluated(by_title[title][target], read, now)

        assert shown("Gate") == {"FAIL" if red else "PASS": 1.0}
        (limit,) = shown("Gap per axis (G)", 1).values()
        over = {axis for axis, gap in shown("Gap per axis (G)").items() if gap > limit}
        assert over == ({"headline", "task"} if red else set())
        (low,) = shown("$axis: G with its 95 % interval", 1).values()
        assert (low > limit) == red
        codes = shown("Results")
        assert {axis for axis, code in codes.items() if code == 1} == (
            {"headline", "task", "all"} if red else set()
        )
        assert shown("Age of the evidence") == {
            "s2r_gap_evidence_since_timestamp_seconds": pytest.approx(0.125)
        }
        assert shown("Parameters of the simulator")["damping"] == 0.8


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="no systemd")
def test_the_units_are_verified_by_systemd() -> None:
    units = [str(EXAMPLES / f"s2r-nightly.{kind}") for kind in ("service", "timer")]
    done = subprocess.run(["systemd-analyze", "verify", "--man=no", *units],
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


def unit(kind: str) -> configparser.ConfigParser:
    found = configparser.ConfigParser(interpolation=None, strict=True)
    found.optionxform = str  # type: ignore[method-assign, assignment]
    found.read(EXAMPLES / f"s2r-nightly.{kind}")
    return found


def arguments(command: str) -> list[str]:
    """The words after `s2r` of a command line."""
    words = shlex.split(command)
    return words[next(at for at, word in enumerate(words) if Path(word).name == "s2r") + 1 :]


def test_the_timer_starts_the_service_and_the_service_the_night() -> None:
    service, timer = unit("service"), unit("timer")
    assert timer["Timer"]["Unit"] == "s2r-nightly.service"
    assert timer["Timer"]["Persistent"] == "true"
    assert re.fullmatch(r"\*-\*-\* \d\d:\d\d:\d\d UTC", timer["Timer"]["OnCalendar"])
    assert service["Service"]["Type"] == "oneshot"
    assert service["Service"]["SuccessExitStatus"] == "3"
    _is_nightly(arguments(service["Service"]["ExecStart"]))


def test_the_scrontab_line_is_one() -> None:
    lines = (EXAMPLES / "s2r-nightly.scrontab").read_text().splitlines()
    options = [line for line in lines if line.startswith("#SCRON")]
    assert all(re.fullmatch(r"#SCRON --[a-z-]+=\S+", line) for line in options)
    (entry,) = [line for line in lines if line and not line.startswith("#")]
    assert lines[-1] == entry
    *times, command = entry.split(maxsplit=5)
    bounds = ((0, 59), (0, 23), (1, 31), (1, 12), (0, 7))
    for time, (low, high) in zip(times, bounds, strict=True):
        assert time == "*" or low <= int(time) <= high
    _is_nightly(arguments(command))


def test_the_workflow_judges_and_keeps_what_was_found() -> None:
    yaml = pytest.importorskip("ruamel.yaml")
    found = yaml.YAML(typ="safe", pure=True).load((EXAMPLES / "github-actions.yml").read_text())
    assert set(found["on"]) == {"pull_request", "schedule"}
    (job,) = found["jobs"].values()
    steps = job["steps"]
    runs = [step["run"].strip().splitlines()[-1] for step in steps if "run" in step]
    words = [arguments(run) for run in runs if Path(run.split()[0]).name == "s2r"]
    assert [each[0] for each in words] == ["gap", "nightly"]
    assert {"--reference", "--golden", "--out"} <= set(words[0])
    _is_nightly(words[1])
    upload = next(step for step in steps if "upload-artifact" in step.get("uses", ""))
    assert upload["if"] == "${{ !cancelled() }}"
    assert "reports/latest/junit.xml" in upload["with"]["path"].split()


def _is_nightly(words: list[str]) -> None:
    options = build_parser(["nightly"]).parse_args(words)
    assert options.config.name == "nightly.toml"

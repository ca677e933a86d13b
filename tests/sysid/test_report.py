"""Result files of the identification, and the command."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rtools.sysid import report
from s2rtui.cli import main
from tests.sysid.conftest import DriveFolder

FAST = ["--seeds", "1", "--evaluations", "40"]


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "out"


@pytest.fixture
def run(drive_folder: Callable[..., DriveFolder], out: Path) -> Callable[..., int]:
    """The exit code of a quick identification from drives of a slower and heavier robot."""
    drives = drive_folder(latency=0.8, mass=1.0)[0]
    return lambda *options: main(["sysid", str(drives), "--out", str(out), *FAST, *options])


def test_result_files_agree_and_no_others_are_written(identified, tmp_path):
    result = report.write(tmp_path / "out", identified, None)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"sysid.json", "sysid.txt", "convergence.png"}
    assert json.loads((tmp_path / "out/sysid.json").read_text()) == result
    text = (tmp_path / "out/sysid.txt").read_text()
    assert all(estimate.name in text for estimate in identified.estimates)


def test_the_table_contains_warnings(identified_unequal_wheels):
    assert "warning: structural mismatch" in report.table(report.record(identified_unequal_wheels))


def test_the_command_writes_and_prints(drive_folder, run, out, capsys):
    ranges = ["--range", "latency=0..0.6", "--range", "mass=4..30:linear"]
    assert run("--json", *ranges) == 0
    result = json.loads(capsys.readouterr().out)
    assert result == json.loads((out / "sysid.json").read_text())
    drives = drive_folder(latency=0.8, mass=1.0)[0]
    truth = json.loads((drives / "truth.json").read_text())["values"]
    assert result["estimates"]["mass"]["value"] == pytest.approx(16.0, rel=0.01)
    assert result["estimates"]["latency"]["value"] == pytest.approx(truth["latency"], abs=2e-3)
    assert result["ranges"]["mass"] == [4.0, 30.0, "linear"]


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--simulator", "bullet"], "--simulator bullet: unknown"),
        (["--parameters", "weight"], "weight: no parameter"),
        (["--parameters", ","], "--parameters: is empty; give names"),
        (["--fix", "track"], "--fix track: expected NAME=VALUE"),
        (["--seeds", "0"], "--seeds"),
        (["--window", "nan"], "--window"),
    ],
)
def test_invalid_requests_exit_with_2_and_write_nothing(run, out, capsys, options, line):
    assert run(*options) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert line in error[-1]
    assert not out.exists()


def test_a_missing_folder_and_a_file_as_folder_exit_with_2(tmp_path):
    (tmp_path / "file").write_text("")
    assert main(["sysid", str(tmp_path / "no"), "--out", str(tmp_path / "out")]) == 2
    assert main(["sysid", str(tmp_path), "--out", str(tmp_path / "file")]) == 2


def test_undetermined_parameters_exit_with_3(run, out, capsys):
    assert run("--parameters", "mass,gain,friction,damping,drag") == 3
    assert "do not determine" in capsys.readouterr().err
    result = json.loads((out / "sysid.json").read_text())
    assert result["conclusive"] is False
    assert any("only their ratios are known" in line for line in result["warnings"])
    mass = result["estimates"]["mass"]
    assert (mass["low"], mass["high"]) == (2.0, 60.0)


@pytest.mark.parametrize(("limits", "line"), [
    ("latency=0..0.1..2", "--range latency=0..0.1..2: expected LOW..HIGH"),
    ("latency=0..1:root", "expected LOW..HIGH"),
    ("weight=1..2", "weight: no parameter"),
    ("mass=9..3", "the lower first"),
    ("mass=0..3", "must be above 0"),
    ("latency=0..1:log", "must begin above 0"),
    ("wheels=-2..2", "must lie within -1 .. 1"),
    ("track=0.1..0.2", "track: not searched"),
])  # fmt: skip
def test_invalid_ranges_are_reported_first(run, out, capsys, limits, line):
    assert run("--range", limits) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert len(error) == 1
    assert line in error[0]
    assert not out.exists()


def test_a_too_narrow_range_exits_with_3(run, out, capsys):
    assert run("--range", "latency=0..0.05", "--parameters", "latency,mass") == 3
    assert (
        "latency at a bound of the search range; widen it with --range" in capsys.readouterr().err
    )
    result = json.loads((out / "sysid.json").read_text())
    assert (result["conclusive"], result["at_ends"]) == (False, ["latency"])
    assert not result["estimates"]["latency"]["identified"]
    assert any("end of the range 0 .. 0.05 s" in line for line in result["warnings"])


def test_the_topic_is_passed_to_the_bag_reader(tmp_path, monkeypatch):
    from s2rtools import motion_logs

    calls = []

    def read(folder: Path, topic: str | None) -> None:
        calls.append((folder, topic))
        raise RequestError("no bags")

    monkeypatch.setattr(motion_logs, "read_drives", read)
    command = ["sysid", str(tmp_path), "--out", str(tmp_path / "out"), "--topic", "/odom"]
    assert main(command) == 2
    assert calls == [(tmp_path, "/odom")]


def test_coarse_logs_skip_only_the_residual_network(run, out, capsys, monkeypatch):
    from s2rtools.sysid import residual_network

    monkeypatch.setattr(residual_network, "STEP", 0.001)
    assert run("--residual") == 3
    assert "--residual: needs at least 4 poses" in capsys.readouterr().err
    result = json.loads((out / "sysid.json").read_text())
    assert result["conclusive"]
    assert "residual" not in result

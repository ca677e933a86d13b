"""Results as files, and the command."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rtools.sysid import Identification, report
from s2rtools.sysid.convergence_plot import convergence_figure
from s2rtui.cli import main
from tests.sysid.conftest import Made

FAST = ["--seeds", "1", "--evaluations", "60"]


def test_files_tell_the_same_and_leave_nothing_beside(
    plain: Identification, tmp_path: Path
) -> None:
    told = report.write(tmp_path / "out", plain, None)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"sysid.json", "sysid.txt", "convergence.png"}
    assert json.loads((tmp_path / "out/sysid.json").read_text()) == told
    text = (tmp_path / "out/sysid.txt").read_text()
    assert all(one.name in text for one in plain.estimates)


def test_a_warning_stands_in_the_table(unequal: Identification) -> None:
    assert "warning: structural mismatch" in report.table(report.result_json(unequal, None))


def test_the_curve_is_the_same_to_the_byte(plain: Identification) -> None:
    one, other = (convergence_figure(plain.traces, "title") for _ in range(2))
    assert one == other
    assert one.startswith(b"\x89PNG")


def test_the_command_writes_and_prints(
    made: Callable[..., Made], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drives = made(latency=0.8, mass=1.0)[0]
    out = tmp_path / "out"
    assert main(["sysid", str(drives), "--out", str(out), "--json", *FAST]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told == json.loads((out / "sysid.json").read_text())
    assert told["estimates"]["mass"]["value"] == pytest.approx(16.0, rel=0.01)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--simulator", "bullet"], "--simulator bullet: unknown"),
        (["--parameters", "weight"], "weight: no parameter"),
        (["--parameters", ","], "--parameters: is empty; give names"),
        (["--fix", "track"], "--fix track: must be NAME=VALUE"),
        (["--fix", "track=nan"], "track=nan: out of its range"),
        (["--seeds", "0"], "--seeds"),
        (["--window", "nan"], "--window"),
    ],
)
def test_wrong_requests_end_with_2_and_write_nothing(
    made: Callable[..., Made],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    line: str,
) -> None:
    drives, out = made(latency=0.8, mass=1.0)[0], tmp_path / "out"
    assert main(["sysid", str(drives), "--out", str(out), *FAST, *words]) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert line in error[-1]
    assert not out.exists()


def test_a_missing_folder_and_a_file_for_a_folder_end_with_2(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert main(["sysid", str(tmp_path / "no"), "--out", str(tmp_path / "out")]) == 2
    assert main(["sysid", str(tmp_path), "--out", str(tmp_path / "file")]) == 2


def test_what_drives_leave_open_ends_with_3(
    made: Callable[..., Made], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drives, out = made(latency=0.8, mass=1.0)[0], tmp_path / "out"
    words = ["--parameters", "mass,gain,friction,damping,drag", *FAST]
    assert main(["sysid", str(drives), "--out", str(out), *words]) == 3
    assert "do not determine" in capsys.readouterr().err
    assert json.loads((out / "sysid.json").read_text())["conclusive"] is False


@pytest.mark.parametrize(("words", "line"), [
    (["latency=0..0.1..2"], "latency=0..0.1..2: NAME=0..0.1..2: expected LOW..HIGH"),
    (["latency"], "NAME=: expected LOW..HIGH"),
    (["latency=0..1:root"], "expected LOW..HIGH"),
    (["weight=1..2"], "weight: no parameter"),
    (["mass=9..3"], "the lower first"),
    (["mass=0..3"], "must be above 0"),
    (["mass=1..inf"], "must be two numbers"),
    (["latency=-1..1"], "must be at least 0"),
    (["latency=0..1:log"], "must begin above 0"),
    (["wheels=-2..2"], "must lie within -1 .. 1"),
    (["track=0.1..0.2"], "track: not searched"),
])  # fmt: skip
def test_wrong_ranges_are_told_before_anything_is_done(
    made: Callable[..., Made], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    words: list[str], line: str,
) -> None:  # fmt: skip
    drives, out = made(latency=0.8, mass=1.0)[0], tmp_path / "out"
    given = [word for each in words for word in ("--range", each)]
    assert main(["sysid", str(drives), "--out", str(out), *FAST, *given]) == 2
    error = capsys.readouterr().err.strip().splitlines()
    assert len(error) == 1
    assert line in error[0]
    assert not out.exists()


def test_a_range_without_the_truth_ends_with_3_and_a_wider_one_finds_it(
    made: Callable[..., Made], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drives, out = made(latency=0.8, mass=1.0)[0], tmp_path / "out"
    command = ["sysid", str(drives), "--out", str(out), *FAST, "--range"]
    assert main([*command, "latency=0..0.05"]) == 3
    assert (
        "latency at a bound of the search range; widen it with --range" in capsys.readouterr().err
    )
    told = json.loads((out / "sysid.json").read_text())
    assert (told["conclusive"], told["at_ends"]) == (False, ["latency"])
    assert not told["estimates"]["latency"]["identified"]
    assert any("end of the range 0 .. 0.05 s" in line for line in told["warnings"])
    assert main([*command, "latency=0..0.6", "--range", "mass=4..30:linear"]) == 0
    told = json.loads((out / "sysid.json").read_text())
    truth = json.loads((drives / "truth.json").read_text())["values"]
    assert told["estimates"]["latency"]["value"] == pytest.approx(truth["latency"], abs=2e-3)
    assert told["ranges"]["mass"] == [4.0, 30.0, "linear"]


def test_bags_are_read_by_the_topic_that_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from s2rtools import motion_logs

    asked = []

    def read(folder: Path, topic: str | None) -> None:
        asked.append((folder, topic))
        raise RequestError("no bags")

    monkeypatch.setattr(motion_logs, "read_drives", read)
    words = ["sysid", str(tmp_path), "--out", str(tmp_path / "out"), "--topic", "/odom"]
    assert main(words) == 2
    assert asked == [(tmp_path, "/odom")]


def test_coarse_logs_lose_only_the_network(
    made: Callable[..., Made], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    from s2rtools.sysid import residual_training

    monkeypatch.setattr(residual_training, "STEP", 0.001)
    drives, out = made(latency=0.8, mass=1.0)[0], tmp_path / "out"
    assert main(["sysid", str(drives), "--out", str(out), "--residual", *FAST]) == 3
    assert "--residual: needs at least 4 poses" in capsys.readouterr().err
    told = json.loads((out / "sysid.json").read_text())
    assert told["conclusive"]
    assert "residual" not in told


def test_too_few_drives_end_with_3_and_write_nothing(
    made: Callable[..., Made], tmp_path: Path
) -> None:
    drives, out = made(latency=0.8, mass=1.0)[0], tmp_path / "out"
    assert main(["sysid", str(drives), "--out", str(out), "--held-out", "6"]) == 3
    assert not out.exists()

"""Invalid logs end both commands with a one-line error that names the place, and no output."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from s2rtools.motion_logs import csv_reader
from s2rtools.sysid.synthetic_drives import DriveSettings, make_drives
from s2rtui.cli import main

Damage = Callable[[Path], None]
GAP, SYSID = ("gap", "sysid")


@pytest.fixture(scope="module")
def valid_drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("good") / "drives"
    make_drives(folder, 3, {"latency": 0.5}, DriveSettings(count=5, seconds=4.0))
    return folder


def lines(change: Callable[[list[str]], object], name: str = "real.csv") -> Damage:
    """Modify the lines of one file."""

    def damage(drive: Path) -> None:
        file_lines = (drive / name).read_text().splitlines()
        change(file_lines)
        (drive / name).write_text("\n".join(file_lines) + "\n")

    return damage


def row(i: int, text: str, name: str = "real.csv") -> Damage:
    return lines(lambda file_lines: file_lines.__setitem__(i, text), name)


def replaced(content: bytes, name: str = "real.csv") -> Damage:
    return lambda drive: (drive / name).write_bytes(content) and None


def clock(start: float, factor: float) -> Damage:
    def damage(drive: Path) -> None:
        log = csv_reader.read(drive / "real.csv")
        csv_reader.write(replace(log, time=start + factor * log.time), drive / "real.csv")

    return damage


def run(command: str, drives: Path, store: Path, out: Path) -> int:
    arguments = {
        GAP: ["gap", str(store), "--drives", str(drives), "--axis", "dynamics", "--axis", "delay"],
        SYSID: ["sysid", str(drives), "--seeds", "1", "--evaluations", "10"],
    }  # fmt: skip
    return main([*arguments[command], "--out", str(out)])


def damaged_copy(valid_drives: Path, folder: Path, damage: Damage) -> Path:
    shutil.copytree(valid_drives, folder)
    damage(folder / "drive-00")
    return folder


FAULTS: dict[str, tuple[Damage, str, str, int]] = {
    "nan": (row(9, "0.18,nan,0,0"), *2 * ("real.csv:10: x is nan; remove the row",), 2),
    "header": (row(9, "time,x,y,heading"), *2 * ("real.csv:10: time is time, not a number",), 2),
    "no sim": (lambda drive: (drive / "sim.csv").unlink(), *2 * ("drive-00: no sim.* in it",), 2),
    "command": (row(9, "0.4,inf,0", "commands.csv"),
                *2 * ("commands.csv:10: left_torque is inf",), 2),
    "apart": (clock(1000.0, 1.0), "(1000 to 1003.98 s) and",
              "poses from 1000 to 1003.98 s, commands", 3),
    "three rows": (lines(lambda f: f.__delitem__(slice(4, None))), "real.csv: 3 poses in 0.04 s",
                   "poses from 0 to 0.04 s", 3),
    "milliseconds": (clock(0.0, 1000.0), "a pose every 20 s is too slow to estimate a time delay",
                     "poses from 0 to 3980 s, commands from 0 to 4 s", 3),
}  # fmt: skip
"""Damage of a drive, what `gap` and `sysid` say of it, and the exit code of `sysid`."""


@pytest.mark.parametrize("fault", FAULTS)
def test_invalid_or_incompatible_logs_are_named_in_one_line(
    valid_drives, tiny_store, tmp_path, capsys, fault
):
    damage, gap, sysid, sysid_code = FAULTS[fault]
    drives, out = damaged_copy(valid_drives, tmp_path / "drives", damage), tmp_path / "out"
    for command, expected, code in ((GAP, gap, 2), (SYSID, sysid, sysid_code)):
        assert run(command, drives, tiny_store, out) == code
        error = capsys.readouterr().err.strip()
        assert expected in error
        assert "\n" not in error
        assert not out.exists()


def drive_straight(drive: Path) -> None:
    """Both logs drive straight at a constant speed."""
    for name in ("real", "sim"):
        log = csv_reader.read(drive / f"{name}.csv")
        zero = np.zeros(log.time.size)
        csv_reader.write(
            replace(log, x=0.4 * log.time, y=zero, heading=zero), drive / f"{name}.csv"
        )


def degrees(drive: Path) -> None:
    log = csv_reader.read(drive / "real.csv")
    csv_reader.write(replace(log, heading=np.degrees(log.heading)), drive / "real.csv")


def millimetres(drive: Path) -> None:
    log = csv_reader.read(drive / "real.csv")
    csv_reader.write(replace(log, x=1000 * log.x, y=1000 * log.y), drive / "real.csv")


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (drive_straight, "the motion never changes; no time delay can be estimated"),
        (degrees, "if these are degrees, name the column heading_deg"),
        (millimetres, "are both logs in metres and seconds?"),
    ],
)
def test_doubtful_logs_are_reported_with_the_results(
    valid_drives, tiny_store, tmp_path, capsys, damage, expected
):
    drives = damaged_copy(valid_drives, tmp_path / "drives", damage)
    options = ["--dynamics", "horizons=0.5,1"]
    command = ["gap", str(tiny_store), "--drives", str(drives), *options]
    assert main([*command, "--axis", "dynamics", "--axis", "delay"]) == 3
    assert expected in capsys.readouterr().out

"""A night on ROS bags with several topics."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.support import robot
from s2rtools.motion_logs import csv_reader
from s2rtools.nightly.config import NightlyConfig
from s2rtui.cli import main
from tests.support.bags import ODOMETRY, POSE, write


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

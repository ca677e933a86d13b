"""The ROS package with the launch file."""

import os
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from bench.support.ros_programs import missing_ros
from s2rtui.cli import main


@pytest.fixture
def package(capsys: pytest.CaptureFixture[str]) -> Path:
    assert main(["ros", "package"]) == 0
    return Path(capsys.readouterr().out.strip())


def test_the_node_runs_the_given_program(package):
    assert ElementTree.parse(package / "package.xml").findtext("name") == "s2rtui"
    environment = {"PATH": "/nowhere", "S2R_PROGRAM": "/bin/echo"}
    command = [str(package / "proxy"), "--in", "/a b"]
    told = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert told.stdout == "ros proxy --in /a b\n"


def test_roslaunch_starts_the_node_with_the_arguments(package, tmp_path):
    if missing_ros():
        pytest.skip(f"ROS 1 is not installed: {missing_ros()} is missing (see .ci/programs)")
    environment = os.environ | {"ROS_PACKAGE_PATH": str(package), "ROS_HOME": str(tmp_path)}
    command = ["roslaunch", "--args", "/translation_proxy", "s2rtui", "proxy.launch",
               "translator:=look.safetensors", "options:=--max-age 100ms",
               "program:=/opt/s2r"]  # fmt: skip
    told = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert "S2R_PROGRAM" in told.stdout
    assert "/opt/s2r" in told.stdout
    assert "--translator look.safetensors --in /camera/image_raw/compressed" in told.stdout
    assert "--max-age 100ms" in told.stdout

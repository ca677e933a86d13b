"""`s2r ros replay`, its bags in ROS's own tools, and the ROS package with the launch file."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

import s2rstore
from bench.support.ros_programs import missing_ros
from s2rstore.maintenance.verify import verify
from s2rtools.common.frame_resizing import resized_rgb
from s2rtools.datasets.writing import image_instances
from s2rtools.ros.ros_environment import SYSTEM_PACKAGES
from s2rtools.translation.colour_maps import MklTranslator
from s2rtui.cli import main
from tests.support.image_bags import COMPRESSED, IMAGES, RAW, START, grey_images, write_image_bag

_READ = """
import sys
sys.path.append(sys.argv[2])
import rosbag
with rosbag.Bag(sys.argv[1]) as bag:
    for topic, message, time in bag.read_messages():
        content = getattr(message, "data", "")
        stamp = message.header.stamp.to_nsec() if hasattr(message, "header") else 0
        print(topic, time.to_nsec(), stamp, message._type, len(content))
"""


@pytest.fixture(scope="module")
def ros() -> None:
    missing = missing_ros()
    if missing:
        pytest.skip(f"ROS 1 is not installed: {missing} is missing (see .ci/programs)")


@pytest.mark.usefixtures("ros")
@pytest.mark.parametrize("kind", [COMPRESSED, RAW])
def test_ros_reads_a_replayed_bag(tmp_path, translator_file, kind):
    source = write_image_bag(tmp_path / "a.bag", grey_images(3), kind)
    target = tmp_path / "b.bag"
    arguments = ["ros", "replay", str(source), "--translator", str(translator_file)]
    assert main([*arguments, "--out", str(target)]) == 0
    command = [sys.executable, "-c", _READ, str(target), SYSTEM_PACKAGES]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    rows = [line.split() for line in lines]
    images = [row for row in rows if row[0] == IMAGES]
    assert [int(row[2]) for row in images] == [START + i * 33_000_000 for i in range(3)]
    assert [int(row[1]) for row in images] == [int(row[2]) for row in images]
    assert images[0][3] == kind.replace("/msg/", "/")
    assert len(rows) == 6
    told = subprocess.run(["rosbag", "info", str(target)], check=True, capture_output=True)
    assert f"{IMAGES} " in told.stdout.decode()


def test_replay_names_the_topic_and_refuses_others(tmp_path, translator_file, s2r):
    source = write_image_bag(tmp_path / "a-mcap", grey_images(2))
    arguments = ["ros", "replay", str(source), "--translator", str(translator_file)]
    assert "2 images translated" in s2r(*arguments, "--in", IMAGES, "--out", tmp_path / "b").printed
    s2r(*arguments, "--in", "/none", "--out", tmp_path / "c").assert_refused("no topic /none")
    s2r(*arguments, "--out", tmp_path / "b").assert_refused("exists")


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        (["--strength", "2"], "--strength"),
        (["--jpeg-quality", "0"], "--jpeg-quality"),
        (["--out", "/image/compressed"], "is the input"),
        (["--out", "/other"], "must end in"),
        (["--max-age", "soon"], "--max-age"),
        (["--translator", "missing.safetensors"], "missing.safetensors"),
        (["rubbish"], "rubbish"),
    ],
)
def test_wrong_options_of_the_proxy_end_in_one_line(translator_file, s2r, options, problem):
    arguments = ["ros", "proxy", "--translator", str(translator_file), "--in", "/image/compressed",
                 "--out", "/translated/compressed", *options]  # fmt: skip
    s2r(*arguments).assert_refused(problem)


def test_a_translator_that_loads_torch_later_computes_in_one_thread(translator_file, monkeypatch):
    requests, threads = [], []
    monkeypatch.setattr("s2rtools.ros.ros_environment.find_ros", lambda wanted: 1)
    monkeypatch.setattr("s2rtools.ros.ros1_node.run", requests.append)
    monkeypatch.setattr("cv2.setNumThreads", lambda number: None)
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(set_num_threads=threads.append))
    arguments = ["ros", "proxy", "--translator", str(translator_file), "--in", "/a", "--out", "/b"]
    assert main(arguments) == 0
    threads.clear()
    requests[0].load(str(translator_file))
    assert threads == [1]


def test_missing_ros_names_the_packages_to_install(translator_file, s2r, monkeypatch):
    monkeypatch.setattr("s2rtools.ros.ros_environment._is_installed", lambda name: False)
    arguments = ["ros", "proxy", "--translator", str(translator_file), "--in", "/a", "--out", "/b"]
    s2r(*arguments).assert_refused("apt install python3-rospy")
    s2r(*arguments, "--ros", "2").assert_refused("rclpy")


def test_replay_makes_a_store_of_images_and_translations(tmp_path, translator_file):
    images = [np.full((48, 64, 3), shade, dtype=np.uint8) for shade in (60, 120)]
    source = write_image_bag(tmp_path / "a.bag", images)
    result = tmp_path / "result.s2r"
    arguments = ["ros", "replay", str(source), "--translator", str(translator_file)]
    arguments += ["--out", str(tmp_path / "b.bag"), "--result", str(result)]
    assert main(arguments) == 0
    with s2rstore.open(result) as store:
        assert {name: domain.kind for name, domain in store.domains.items()} == {
            "camera": "real", "translated": "sim",
        }  # fmt: skip
        camera, translated = (
            store.frames(name, 0, 2, ("rgb",))["rgb"] for name in ("camera", "translated")
        )
    assert np.abs(camera[1].astype(int) - images[1]).max() <= 4
    change = translated.astype(int) - camera
    assert change[..., 0].mean() > 5
    assert change[..., 2].mean() < -5
    assert not verify(result)
    assert main(arguments) == 2


def test_replay_to_a_store_holds_few_images_at_once(tmp_path, translator_file, monkeypatch):
    translated, stored, waiting = [], [], []

    def counted(rgb, size):
        stored.append((*size, 3))
        return resized_rgb(rgb, size)

    def translate(self, rgb):
        translated.append(rgb.shape)
        waiting.append(len(translated) - len(stored) // 2)
        return rgb

    monkeypatch.setattr(image_instances, "resized_rgb", counted)
    monkeypatch.setattr(MklTranslator, "translate", translate)
    source = write_image_bag(tmp_path / "a.bag", [np.zeros((48, 640, 3), dtype=np.uint8)] * 40)
    result = tmp_path / "result.s2r"
    arguments = ["ros", "replay", str(source), "--translator", str(translator_file)]
    arguments += ["--out", str(tmp_path / "b.bag"), "--result", str(result)]
    assert main(arguments) == 0
    assert stored == [(24, 320, 3)] * 80
    assert max(waiting) < 10


def test_no_store_is_made_of_a_bag_without_usable_images(tmp_path, translator_file, s2r):
    source = write_image_bag(tmp_path / "a.bag", [])
    result = tmp_path / "result.s2r"
    arguments = ["ros", "replay", str(source), "--translator", str(translator_file)]
    arguments += ["--out", str(tmp_path / "b.bag"), "--result", str(result)]
    assert "no image could be decoded" in s2r(*arguments).checked(2).err
    assert not result.exists()


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

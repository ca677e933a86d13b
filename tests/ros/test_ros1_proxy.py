"""The proxy between a camera and a listener, at a real ROS 1 master."""

import signal

import numpy as np
import pytest

from bench.support.ros_camera import draw
from bench.support.ros_programs import PROXY_TOPIC, Program
from tests.ros.conftest import shifted, wait_until

SMALL = ("--size", "160x120")


def stamps(camera: Program) -> set[int]:
    return {int(line) for line in camera.lines.copy() if line.isdigit()}


def wait_for_images(listener: Program, more: int = 10) -> None:
    wanted = len(listener.rows("image")) + more
    wait_until(lambda: len(listener.rows("image")) >= wanted, "images from the proxy")


def diagnostics(listener: Program) -> dict[str, str]:
    rows = listener.rows("diagnostics")
    return rows[-1]["diagnostics"] if rows else {}


def mean(listener: Program) -> np.ndarray:
    return np.mean([row["mean"] for row in listener.rows("image")[-5:]], axis=0)


@pytest.mark.parametrize(
    ("suffix", "image_format"), [("/compressed", "rgb8; jpeg compressed bgr8"), ("", "bgr8")]
)
def test_whole_images_are_translated_and_keep_stamp_frame_and_format(
    network, translator_file, suffix, image_format
):
    network.master()
    topics = f"/camera/image_raw{suffix}", f"/translated/image_raw{suffix}"
    camera = network.camera(topics[0], *SMALL, "--damage-every", "3")
    listener = network.listener(topics[1], "--decode")
    network.proxy(translator_file, topics=topics)
    wait_for_images(listener, 30)
    wait_until(lambda: listener.rows("info") and listener.rows("latency"), "CameraInfo, latency")
    wait_until(lambda: int(diagnostics(listener).get("dropped, undecodable", 0)) > 3, "counts")
    assert diagnostics(listener)["last error"].startswith("undecodable")
    camera.stop()
    sent = stamps(camera)
    assert {row["image"] for row in listener.rows("image")} <= sent
    assert sent & {row["info"] for row in listener.rows("info")}
    first = listener.rows("image")[0]
    assert first["frame_id"] == "camera_optical"
    assert first["format"] == image_format
    drawn = np.mean([draw(index, 160, 120) for index in range(16)], axis=(0, 1, 2))
    change = mean(listener) - drawn[::-1]  # the camera sends blue first
    assert change[0] > 20
    assert change[2] < -20
    assert all(row["latency"] > 0 for row in listener.rows("latency"))


def test_parameters_change_the_running_node(network, translator_file, tmp_path):
    darker = tmp_path / "other.safetensors"
    from s2rtools.translation.translator_file import encode

    darker.write_bytes(encode(shifted(-40)))
    network.master()
    network.camera("/camera/image_raw/compressed", *SMALL)
    listener = network.listener(PROXY_TOPIC, "--decode")
    network.proxy(translator_file)
    wait_for_images(listener)
    wait_until(lambda: "setting strength" in diagnostics(listener), "diagnostics")
    network.set_parameter("/translation_proxy/strength", 0.5)
    wait_until(lambda: diagnostics(listener)["setting strength"] == "0.5", "strength 0.5")
    network.set_parameter("/translation_proxy/strength", 7.0)
    wait_until(lambda: "strength" in listener.rows("diagnostics")[-1]["message"], "a refusal")
    assert diagnostics(listener)["setting strength"] == "0.5"
    network.set_parameter("/translation_proxy/strength", 1.0)
    before = mean(listener)
    network.set_parameter("/translation_proxy/translator", str(darker))
    wait_until(lambda: diagnostics(listener)["setting translator"] == str(darker), "translator")
    wait_for_images(listener)
    assert mean(listener)[0] < before[0] - 20


def test_the_proxy_waits_for_the_master_and_ends_by_a_signal(network, translator_file):
    proxy = network.proxy(translator_file)
    wait_until(lambda: any("waiting for the ROS master" in line for line in proxy.lines), "waiting")
    network.master()
    network.camera("/camera/image_raw/compressed", *SMALL)
    listener = network.listener()
    wait_for_images(listener)
    assert proxy.stop(signal.SIGINT) == 0
    assert "Traceback" not in "\n".join(proxy.lines)


@pytest.mark.deep
def test_images_flow_again_after_kills_in_any_order(network, translator_file):
    start = {
        "master": network.master,
        "camera": lambda: network.camera("/camera/image_raw/compressed", *SMALL),
        "proxy": lambda: network.proxy(translator_file),
    }
    programs = {name: launch() for name, launch in start.items()}
    wait_for_images(network.listener())
    for order in ("master camera proxy", "proxy camera master"):
        for name in order.split():
            programs[name].stop(signal.SIGKILL)
            programs[name] = start[name]()
        # A listener that knows only the present master finds the present proxy.
        wait_for_images(network.listener())

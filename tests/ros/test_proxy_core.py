"""The proxy without ROS: which frames are dropped, counted, translated and forwarded."""

from __future__ import annotations

import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rtools.ros.proxy_core import Frame, LatestFrame, ProxyCore, SlidingWindow
from s2rtools.ros.proxy_node import camera_info_topic, check_topics, is_compressed
from s2rtools.ros.proxy_settings import ProxySettings, parse_age
from s2rtools.translation.colour_maps import IdentityTranslator
from s2rtools.translation.image_codec import RawLayout, decode_compressed
from tests.ros.conftest import shifted

NOW = 1_000_000.0
LAYOUT = RawLayout("rgb8", 2, 2, 6)


class Proxy:
    """A core whose clock stands still, with its published frames."""

    def __init__(self, **settings: object) -> None:
        self.published: list[tuple[Frame, bytes | None]] = []
        self.now = NOW
        start = ProxySettings("first", shifted(40), **settings)
        self.core = ProxyCore(start, lambda: self.now, lambda *each: self.published.append(each))

    def send(self, frame: Frame) -> None:
        self.core.offer(frame)
        assert self.core.work_once(0)

    def row(self, name: str) -> str:
        return dict(self.core.status().rows)[name]


def grey_frame(stamp: float = NOW, value: int = 100) -> Frame:
    return Frame(bytes([value] * 12), stamp, message="original", layout=LAYOUT)


class Failing(IdentityTranslator):
    def translate(self, rgb):
        raise FloatingPointError("overflow")


class Precise(IdentityTranslator):
    """Records the shapes of the images on which its precision was chosen."""

    def __init__(self, seconds: float = 0, clock: FakeClock | None = None) -> None:
        self.shapes: list[tuple[int, ...]] = []
        self.seconds, self.clock = seconds, clock

    def translate(self, rgb):
        if self.clock is not None:
            self.clock.now += self.seconds
        return rgb

    def use_faster_precision(self, rgb):
        self.shapes.append(rgb.shape)


class FakeClock:
    now = 0.0

    def monotonic(self) -> float:
        return self.now


def load(name: str):
    if name != "second":
        raise RequestError(f"{name}: no such file")
    return shifted(-40)


def test_strength_blends_and_compressed_frames_keep_their_format():
    proxy = Proxy(strength=0.5)
    image = np.full((16, 16, 3), 100, dtype=np.uint8)
    proxy.send(Frame(cv2.imencode(".png", image)[1].tobytes(), NOW))
    content = proxy.published[0][1]
    rgb, _ = decode_compressed(content)
    assert content.startswith(b"\x89PNG")
    assert rgb[0, 0].tolist() == [120, 100, 80]


@pytest.mark.parametrize("settings", [{"strength": 0.0}, {"enabled": False}])
def test_frames_are_forwarded_unchanged_when_nothing_is_translated(settings):
    proxy = Proxy(**settings)
    proxy.send(grey_frame())
    assert proxy.published[0][1] is None
    assert proxy.core.counts.published == 1


def test_the_newest_frame_wins_and_the_others_are_counted():
    proxy = Proxy()
    for index in range(5):
        proxy.core.offer(grey_frame(NOW - 1 + index / 10))
    assert proxy.core.work_once(0)
    assert not proxy.core.work_once(0)
    assert [frame.stamp for frame, _ in proxy.published] == [NOW - 0.6]
    assert proxy.core.counts.received == 5
    assert proxy.core.counts.replaced == 4


def test_old_frames_are_dropped_and_counted():
    """The age counts at the start of the work; a frame without a stamp has none."""
    proxy = Proxy(max_age=0.1)
    for age in (0.05, 0.15, 0.5):
        proxy.send(grey_frame(NOW - age))
    assert (proxy.core.counts.too_old, proxy.core.counts.published) == (2, 1)
    proxy.core.offer(grey_frame(NOW))
    proxy.now = NOW + 1
    proxy.core.work_once(0)
    assert proxy.core.counts.too_old == 3
    proxy.send(grey_frame(0.0))
    assert proxy.core.counts.published == 2


@pytest.mark.parametrize(
    ("stamp", "problem"),
    [(NOW - 60, "older than max_age"), (NOW + 60, "in the future"), (0.0, "no header stamp")],
)
def test_clocks_that_disagree_are_told(stamp, problem):
    proxy = Proxy(max_age=0.1)
    proxy.send(grey_frame())
    assert proxy.core.status().problem == ""
    for _ in range(40):
        proxy.send(grey_frame(stamp))
    assert problem in proxy.core.status().problem
    for _ in range(40):
        proxy.send(grey_frame())
    assert proxy.core.status().problem == ""


def test_undecodable_frames_and_errors_are_counted():
    proxy = Proxy()
    proxy.send(Frame(b"nothing", NOW))
    assert proxy.core.counts.undecodable == 1
    assert "undecodable" in proxy.row("last error")
    proxy.core.settings = replace(
        proxy.core.settings, translator=replace(shifted(0), translator=Failing())
    )
    proxy.send(grey_frame())
    assert proxy.core.counts.failed == 1
    assert "overflow" in proxy.row("last error")


def test_parameters_change_what_the_next_frame_gets():
    proxy = Proxy()
    assert proxy.core.change({"translator": "second", "max_age": 0.2, "other": 1}, load) == ""
    proxy.send(grey_frame())
    assert proxy.published[0][1] == bytes([60, 100, 140] * 4)
    assert proxy.core.settings.parameters() == {
        "translator": "second", "strength": 1.0, "max_age": 0.2, "jpeg_quality": 0, "enabled": True,
    }  # fmt: skip
    proxy.core.change({"max_age": 0, "jpeg_quality": 80}, load)
    assert proxy.core.settings.max_age is None
    assert proxy.core.settings.jpeg_quality == 80


def test_the_precision_of_a_new_translator_is_chosen_before_it_is_used():
    proxy, new = Proxy(), Precise()
    proxy.send(grey_frame())
    before = proxy.core.settings
    seen = []
    new.use_faster_precision = lambda rgb: seen.append((rgb.shape, proxy.core.settings is before))
    stored = replace(shifted(0), translator=new)
    assert proxy.core.change({"translator": "new"}, lambda name: stored) == ""
    for _ in range(3):
        proxy.send(grey_frame())
    assert seen == [((1, 2, 2, 3), True)]
    assert proxy.published[-1][1] == bytes([100] * 12)


def test_a_new_translator_that_fails_is_refused():
    proxy, new = Proxy(), Precise()
    proxy.send(grey_frame())
    new.use_faster_precision = new.restore
    stored = replace(shifted(0), translator=new)
    assert "fails on an image" in proxy.core.change({"translator": "new"}, lambda name: stored)
    assert proxy.core.settings.name == "first"


@pytest.mark.parametrize(("seconds", "times"), [(0.1, 1), (0.3, 0)])
@pytest.mark.parametrize("given", ["at the start", "before the first frame"])
def test_the_precision_of_the_first_translator_is_chosen_once_where_it_is_fast(
    monkeypatch, seconds, times, given
):
    clock = FakeClock()
    monkeypatch.setattr("s2rtools.ros.proxy_core.time", clock)
    proxy, first = Proxy(), Precise(seconds, clock)
    stored = replace(shifted(0), translator=first)
    if given == "at the start":
        start = replace(proxy.core.settings, translator=stored)
        proxy.core = ProxyCore(start, lambda: NOW, lambda *each: proxy.published.append(each))
    else:
        proxy.core.change({"translator": "new"}, lambda name: stored)
    assert first.shapes == []
    for count in range(3):
        proxy.core.offer(replace(grey_frame(), arrival=clock.now))
        assert proxy.core.work_once(0)
        assert len(proxy.published) == count + 1
    assert first.shapes == [(1, 2, 2, 3)] * times


@pytest.mark.parametrize(
    "wrong",
    [{"strength": 2}, {"strength": "x"}, {"strength": True}, {"max_age": -1}, {"enabled": "no"},
     {"max_age": float("nan")}, {"jpeg_quality": 200}, {"translator": 5}, {"translator": "none"}],
)  # fmt: skip
def test_wrong_parameters_are_refused_while_valid_ones_apply(wrong):
    proxy = Proxy()
    (name,) = wrong
    valid = {"enabled": False} if name != "enabled" else {"strength": 0.25}
    before = proxy.core.settings.parameters()
    error = proxy.core.change(wrong | valid, load)
    assert name in error or "none" in error
    assert proxy.core.status().problem == error
    assert proxy.core.settings.parameters() == before | valid


def test_latencies_are_reported_over_a_window():
    proxy = Proxy()
    assert proxy.row("latency p50 (ms)") == "nan"
    proxy.send(grey_frame())
    assert float(proxy.row("latency p99 (ms)")) >= 0
    window = SlidingWindow(4)
    for value in range(100):
        window.add(value)
    assert window.percentiles(0, 50, 100) == [96, 97.5, 99]


def test_a_closed_slot_ends_the_wait_of_the_worker():
    slot: LatestFrame[int] = LatestFrame()
    worker = threading.Thread(target=slot.take, args=(3600,))
    worker.start()
    slot.close()
    worker.join(60)
    assert not worker.is_alive()


@pytest.mark.parametrize(("text", "seconds"), [("100ms", 0.1), ("0.25s", 0.25), ("2", 2.0)])
def test_durations(text, seconds):
    assert parse_age(text) == pytest.approx(seconds)


@pytest.mark.parametrize("text", ["", "ms", "-1s", "0", "inf", "nan", "1h"])
def test_wrong_durations_are_refused(text):
    with pytest.raises(RequestError, match="--max-age"):
        parse_age(text)


def test_topics():
    assert camera_info_topic("/camera/image_raw/compressed") == "/camera/camera_info"
    assert camera_info_topic("/camera/image_raw") == "/camera/camera_info"
    assert is_compressed("/camera/image_raw/compressed", None)
    assert not is_compressed("/camera/image_raw/compressed", "sensor_msgs/Image")
    assert is_compressed("/camera/frames", "sensor_msgs/msg/CompressedImage")
    for output in ("/a/compressed", "/b"):
        with pytest.raises(RequestError, match="--out"):
            check_topics("/a/compressed", output)

"""The proxy without ROS: the newest frame is decoded, translated, encoded and published.

A subscriber offers frames in one thread, a worker translates in another. A frame that arrives while
the worker is busy replaces the one that waits, so that the delay never grows.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np

from s2rstore.errors import RequestError, first_line
from s2rtools.ros.proxy_settings import LoadTranslator, ProxySettings
from s2rtools.translation.image_codec import (
    RawLayout,
    UndecodableImageError,
    decode_compressed,
    decode_raw,
)
from s2rtools.translation.image_set import Rgb
from s2rtools.translation.method import Translator, translate_image
from s2rtools.translation.translator_file import StoredTranslator

T = TypeVar("T")
FUTURE = 0.05
"""Seconds by which a stamp may lie in the future; clocks synchronised by NTP differ by less."""
_FRAMES = 30
"""Frames after which a problem is reported."""
SILENCE = 5.0
"""Seconds without a frame after which the diagnostics warn."""
_SLOW = 0.2
"""Latency in seconds from which on the worker does not try another precision."""


class LatestFrame(Generic[T]):
    """A queue of one frame: `put` replaces a frame that was not taken yet."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._frame: T | None = None
        self._closed = False

    def put(self, frame: T) -> bool:
        """Store a frame; returns whether it replaced another."""
        with self._changed:
            replaced, self._frame = self._frame is not None, frame
            self._changed.notify()
        return replaced

    def take(self, timeout: float) -> T | None:
        """Take the frame; waits up to `timeout` seconds, then returns None."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._frame is not None, timeout)
            frame, self._frame = self._frame, None
        return frame

    def close(self) -> None:
        """End the waiting of `take`."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class SlidingWindow:
    """The last `size` values, with percentiles."""

    def __init__(self, size: int = 900) -> None:
        self._lock = threading.Lock()
        self._values: deque[float] = deque(maxlen=size)

    def add(self, value: float) -> None:
        with self._lock:
            self._values.append(value)

    def percentiles(self, *percents: float) -> list[float]:
        """Percentiles of the window, NaN while it is empty."""
        with self._lock:
            values = np.array(self._values)
        if not len(values):
            return [float("nan")] * len(percents)
        return [float(value) for value in np.percentile(values, percents)]


class ClockCheck:
    """Collects the ages of frames: do the clocks of camera and proxy agree?

    `problem` is one line, empty where the stamps make sense.
    """

    def __init__(self) -> None:
        self._ages: deque[float] = deque(maxlen=_FRAMES)
        self._unstamped = 0
        self._max_age: float | None = None

    def add(self, stamp: float, age: float, max_age: float | None) -> None:
        """Add a frame by its stamp and age in seconds; a stamp of 0 means none."""
        self._max_age = max_age
        if stamp > 0:
            self._unstamped = 0
            self._ages.append(age)
        else:
            self._unstamped += 1

    @property
    def problem(self) -> str:
        if self._unstamped >= _FRAMES and self._max_age is not None:
            return "frames have no header stamp; max_age has no effect on them"
        if len(self._ages) < _FRAMES:
            return ""
        middle = float(np.median(self._ages))
        if middle < -FUTURE:
            return (
                f"frames are stamped {-middle:.3g} s in the future; "
                "synchronise the clocks of camera and proxy"
            )
        if self._max_age is not None and min(self._ages) > self._max_age:
            return (
                f"the last {_FRAMES} frames were older than max_age ({middle:.3g} s); "
                "synchronise the clocks of camera and proxy, or raise max_age"
            )
        return ""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One image message. `stamp` is the time of its header in seconds, 0 where it has none;
    `layout` is None for compressed images; `arrival` is on the monotonic clock."""

    content: bytes
    stamp: float
    message: Any = None
    layout: RawLayout | None = None
    arrival: float = field(default_factory=time.monotonic)


@dataclass(frozen=True, slots=True)
class Counts:
    """Frames since the start. `replaced` ones were dropped because a newer one arrived, `too_old`
    ones because of `max_age`; `failed` ones ended in an error of the translator or of ROS."""

    received: int = 0
    published: int = 0
    replaced: int = 0
    too_old: int = 0
    undecodable: int = 0
    failed: int = 0


@dataclass(frozen=True, slots=True)
class Status:
    """State for diagnostics: `problem` is empty where all is well; `rows` are names and values."""

    problem: str
    rows: list[tuple[str, str]]


class ProxyCore:
    """Translates frames. `publish(frame, content)` sends a result, where content None stands for
    the unchanged frame; `ros_time()` are the seconds of the clock that stamps headers."""

    def __init__(
        self,
        settings: ProxySettings,
        ros_time: Callable[[], float],
        publish: Callable[[Frame, bytes | None], None],
        report_latency: Callable[[float], None] = lambda seconds: None,
    ) -> None:
        self.settings = settings
        self._ros_time, self._publish, self._report_latency = ros_time, publish, report_latency
        self._slot: LatestFrame[Frame] = LatestFrame()
        self._latency, self._age = SlidingWindow(), SlidingWindow()
        self._clock = ClockCheck()
        self._counts, self._lock = Counts(), threading.Lock()
        self._last_frame = time.monotonic()
        self._last_error = self._setting_error = ""
        self._last_image: Rgb | None = None  # (1, H, W, 3)
        self._unprepared: Translator | None = settings.translator.translator

    @property
    def counts(self) -> Counts:
        return self._counts

    def offer(self, frame: Frame) -> None:
        """Take a frame from the subscriber; it replaces one that still waits."""
        self._last_frame = frame.arrival
        self._count("received")
        if self._slot.put(frame):
            self._count("replaced")

    def change(self, parameters: Mapping[str, Any], load: LoadTranslator) -> str:
        """Apply changed ROS parameters; returns the errors of wrong values, which change
        nothing.

        Frames are translated as before until a new translator is loaded and its precision chosen.
        """

        def load_prepared(name: str) -> StoredTranslator:
            stored = load(name)
            self._prepare(name, stored.translator)
            return stored

        errors = []
        for name, value in parameters.items():
            try:
                self.settings = self.settings.changed({name: value}, load_prepared)
            except RequestError as error:
                errors.append(first_line(error))
        self._setting_error = "; ".join(errors)
        return self._setting_error

    def work(self, stop: threading.Event) -> None:
        """Translate frames until `stop` is set; `close` ends a wait at once."""
        while not stop.is_set():
            self.work_once(0.5)

    def work_once(self, timeout: float) -> bool:
        """Translate the frame that waits, if one arrives within `timeout` seconds."""
        frame = self._slot.take(timeout)
        if frame is None:
            return False
        settings = self.settings
        age = self._ros_time() - frame.stamp
        self._clock.add(frame.stamp, age, settings.max_age)
        if settings.max_age is not None and frame.stamp > 0 and age > settings.max_age:
            self._count("too_old")
            return True
        try:
            content = self._translated(frame, settings)
            self._publish(frame, content)
        except UndecodableImageError as error:
            self._count("undecodable")
            self._last_error = f"undecodable image: {first_line(error)}"
        except Exception as error:  # one frame must not end the node
            self._count("failed")
            self._last_error = f"{type(error).__name__}: {first_line(error)}"
        else:
            self._count("published")
            seconds = time.monotonic() - frame.arrival
            self._latency.add(seconds)
            if frame.stamp > 0:
                self._age.add(self._ros_time() - frame.stamp)
            self._report_latency(seconds)
            if content is not None and seconds < _SLOW:
                self._prepare_first(settings)
        return True

    def _prepare_first(self, settings: ProxySettings) -> None:
        """Choose the precision of a translator that was loaded before the first frame."""
        if settings.translator.translator is self._unprepared:
            self._unprepared = None
            try:
                self._prepare(settings.name, settings.translator.translator)
            except RequestError as error:
                self._last_error = first_line(error)

    def _prepare(self, name: str, translator: Translator) -> None:
        """Choose the precision of a translator on the last image, if there is one.

        Raises RequestError if the translator fails.
        """
        if self._last_image is None:
            self._unprepared = translator
            return
        try:
            translator.use_faster_precision(self._last_image)
        except Exception as error:  # whatever a translator raises, the node must go on
            raise RequestError(
                f"translator {name}: fails on an image ({first_line(error)}); choose another"
            ) from error

    def close(self) -> None:
        """End the wait of the worker."""
        self._slot.close()

    def status(self) -> Status:
        """Counts, latencies and the first problem, for diagnostics."""
        counts, settings = self._counts, self.settings
        rows = [
            ("received", str(counts.received)),
            ("published", str(counts.published)),
            ("dropped, newer frame arrived", str(counts.replaced)),
            ("dropped, older than max_age", str(counts.too_old)),
            ("dropped, undecodable", str(counts.undecodable)),
            ("dropped, error", str(counts.failed)),
            *_milliseconds("latency", (50, 95, 99), self._latency),
            *_milliseconds("age", (50, 99), self._age),
            ("last error", self._last_error),
            *[(f"setting {name}", str(value)) for name, value in settings.parameters().items()],
        ]  # fmt: skip
        silent = time.monotonic() - self._last_frame
        waiting = f"no image for {silent:.0f} s" if silent > SILENCE else ""
        return Status(self._setting_error or self._clock.problem or waiting, rows)

    def _translated(self, frame: Frame, settings: ProxySettings) -> bytes | None:
        """Content of the translated image; None where it stays as it is."""
        if frame.layout is None:
            rgb, image_format = decode_compressed(frame.content, settings.jpeg_quality)
        else:
            rgb, image_format = decode_raw(frame.content, frame.layout)
        self._last_image = rgb[None]
        if not settings.enabled or settings.strength == 0:
            return None
        translator = settings.translator.translator
        return image_format.encode(translate_image(translator, rgb, settings.strength))

    def _count(self, name: str) -> None:
        with self._lock:
            self._counts = replace(self._counts, **{name: getattr(self._counts, name) + 1})


def _milliseconds(
    what: str, percents: tuple[int, ...], window: SlidingWindow
) -> list[tuple[str, str]]:
    values = window.percentiles(*percents)
    return [
        (f"{what} p{percent} (ms)", f"{1e3 * value:.1f}")
        for percent, value in zip(percents, values, strict=True)
    ]

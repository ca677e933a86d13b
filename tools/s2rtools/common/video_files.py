"""Videos by PyAV: exact times of frames, frames one after the other or by number, and a writer.

A file is opened by this process, and only containers of videos are read, so that no playlist names
further files.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, missing_package
from s2rstore.files.input_files import open_regular
from s2rtools.common.image_files import MAX_PIXELS

Pixels = NDArray[Any]
_CONTAINERS = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpeg,mpegts,mpegvideo"
_UNTIMED = ("avi", "mpegvideo")
"""Containers that state no times of presentation."""
_DEEP = ("gray16", "gray14", "gray12", "gray10")
"""Beginnings of the names of pixel formats that hold depth of 10 to 16 bits."""
_AHEAD = 60
"""Frames that are decoded to reach one ahead; beyond, the video is searched."""
CODECS = {".mp4": "mpeg4", ".avi": "mjpeg", ".mkv": "mjpeg", ".mov": "mpeg4"}
"""Codecs of written videos by suffix."""


def _library() -> ModuleType:
    try:
        import av
    except ModuleNotFoundError as error:
        if error.name != "av":
            raise
        raise missing_package("av", "tools") from None
    module: ModuleType = av
    return module


class Video:
    """An open video: `size` (height, width), `codec`, and `rate` in frames per second.

    One frame at a time is decoded and held. Raises RequestError where the file is no video.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._av = _library()
        self._stack = ExitStack()
        try:
            file = self._stack.enter_context(open_regular(path))
            options = {"format_whitelist": _CONTAINERS}
            self._container = self._av.open(file, options=options)
            self._stack.callback(self._container.close)
            self._stream: Any = next(iter(self._container.streams.video), None)
            if self._stream is None or self._stream.codec_context is None:
                raise RequestError(f"{path}: holds no video")
            self.size: tuple[int, int] = self._stream.height, self._stream.width
            if not 0 < self.size[0] * self.size[1] <= MAX_PIXELS:
                raise RequestError(f"{path}: images of {self.size[1]}x{self.size[0]} pixels")
            self._stream.thread_type = "AUTO"
        except self._av.FFmpegError as error:
            self.close()
            raise RequestError(f"{path}: cannot be decoded as a video ({_reason(error)})") from None
        except BaseException:
            self.close()
            raise
        rate = self._stream.average_rate
        self.codec = str(self._stream.codec_context.name)
        self.rate = Fraction(rate) if rate and 0 < rate < 1000 else Fraction(30)
        self._stamps: NDArray[np.int64] | None = None
        self._has_times = True
        self._decoder: Iterator[Any] | None = None
        self._next = 0

    def require_depth(self) -> None:
        """Raise RequestError if the pixel format is not grey with 10 to 16 bits."""
        pixels = str(self._stream.codec_context.pix_fmt)
        if not pixels.startswith(_DEEP):
            raise RequestError(
                f"{self.path}: no video of depth, which is grey with 10 to 16 bits: {pixels}"
            )

    def __enter__(self) -> Video:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        self._stack.close()

    @property
    def stamps(self) -> NDArray[np.int64]:
        """(N,) times of the frames in units of the stream, ascending; nothing is decoded.

        Frames of an AVI file, which has none, are numbered and have the constant rate.
        """
        if self._stamps is None:
            packets = self._container.demux(self._stream)
            try:
                found = [packet.pts for packet in packets if packet.size]
            except self._av.FFmpegError as error:
                raise RequestError(f"{self.path}: is damaged ({_reason(error)})") from None
            is_untimed = self._container.format.name in _UNTIMED
            self._has_times = not is_untimed and None not in found
            numbers = found if self._has_times else range(len(found))
            self._stamps = np.unique(np.array(numbers, dtype=np.int64))
            self._decoder = None
        return self._stamps

    @property
    def times(self) -> NDArray[np.float64]:
        """(N,) seconds of the frames on the clock of the video, ascending."""
        stamps = self.stamps
        unit = self._stream.time_base if self._has_times else 1 / self.rate
        return np.asarray(stamps * float(unit), dtype=np.float64)

    def frames(self) -> Iterator[Pixels]:
        """Yield all frames that can be decoded, (H, W, 3) uint8, in one pass from the first."""
        try:
            self._container.seek(0)
            for frame in self._container.decode(self._stream):
                yield self._pixels(frame)
        except self._av.FFmpegError:
            return

    def read(self, number: int) -> Iterator[tuple[int, Pixels]]:
        """Yield frames with their numbers up to the one of a number, which comes last if it is
        decodable: from where the frame before was read, or from the key frame before it.
        """
        stamps = self.stamps
        if not 0 <= number < len(stamps):
            return
        ahead = _AHEAD if self._has_times else len(stamps)
        try:
            if self._decoder is None or not 0 <= number - self._next <= ahead:
                start = int(stamps[number]) if self._has_times else 0
                self._container.seek(start, stream=self._stream)
                self._decoder, self._next = self._container.decode(self._stream), 0
            for frame in self._decoder:
                place = self._next
                if self._has_times:
                    if frame.pts is None:
                        continue
                    place = int(np.searchsorted(stamps, frame.pts))
                self._next = place + 1
                yield place, self._pixels(frame)
                if place >= number:
                    return
        except self._av.FFmpegError:
            pass
        self._decoder = None

    def _pixels(self, frame: Any) -> Pixels:
        """Colours (H, W, 3) uint8, or the stored values (H, W) uint16 of a video of depth."""
        is_deep = frame.format.name.startswith(_DEEP)
        pixels = frame.to_ndarray() if is_deep else frame.to_ndarray(format="rgb24")
        return np.ascontiguousarray(pixels)


class VideoWriter:
    """Writes frames of one size at a constant rate; the codec is that of the suffix in `CODECS`.

    Raises RequestError where the file cannot be written.
    """

    def __init__(self, path: Path, rate: Fraction, size: tuple[int, int]) -> None:
        self._av, self._path = _library(), path
        height, width = size
        try:
            self._container = self._av.open(str(path), "w")
            self._stream = self._container.add_stream(CODECS[path.suffix.lower()], rate=rate)
            self._stream.width, self._stream.height = width, height
            is_mjpeg = self._stream.codec_context.name == "mjpeg"
            self._stream.pix_fmt = "yuvj420p" if is_mjpeg else "yuv420p"
            self._stream.bit_rate = 16_000_000
            if is_mjpeg:
                self._stream.codec_context.qmin = self._stream.codec_context.qmax = 2
        except self._av.FFmpegError as error:
            message = f"{path}: cannot be written as a video of {width} x {height} pixels"
            raise RequestError(f"{message} ({_reason(error)})") from None

    def write(self, rgb: Pixels) -> None:
        """Append a frame (H, W, 3) uint8."""
        frame = self._av.VideoFrame.from_ndarray(rgb, format="rgb24")
        self._mux(frame)

    def close(self) -> None:
        """Write what is left and close the file."""
        self._mux(None)
        self._container.close()

    def _mux(self, frame: Any) -> None:
        try:
            self._container.mux(self._stream.encode(frame))
        except self._av.FFmpegError as error:
            raise RequestError(f"{self._path}: cannot be written ({_reason(error)})") from None


def _reason(error: Any) -> str:
    return str(getattr(error, "strerror", "") or error).lower()

"""Videos by PyAV, for tests."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest


def write_video(
    path: Path,
    codec: str,
    pixels: str,
    frames: Sequence[np.ndarray],
    ticks: Sequence[int] | None = None,
    **options: str,
) -> None:
    """Frames (H, W, 3) or (H, W) at `ticks` of 0.05 s, by default one each."""
    av = pytest.importorskip("av")
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        try:
            stream = container.add_stream(codec, rate=20, options=options)
        except (av.FFmpegError, ValueError):
            pytest.skip(f"this FFmpeg has no encoder {codec}")
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = pixels
        stream.codec_context.time_base = Fraction(1, 20)
        for number, each in enumerate(frames):
            form = "rgb24" if each.ndim == 3 else pixels
            frame = av.VideoFrame.from_ndarray(each, format=form)
            frame.pts = number if ticks is None else int(ticks[number])
            frame.time_base = Fraction(1, 20)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))

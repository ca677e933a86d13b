"""What `s2r render` costs beside the renderer, and how its workers scale: `-m bench rendering`.

The renderer waits until 50 ms have passed for each frame of 640 x 480, the time to write its files
included, so that several fit on one core. Frames are checked and saved as by the command.
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from bench.budget import BudgetRow
from s2rstore.records import Domain, Intrinsics
from s2rtools.renderer.frames import RenderedFrame
from s2rtools.renderer.program_pool import RendererWorkers, RenderJob
from s2rtools.renderer.protocol import Answer, Hello, Ready, Rendered, decode_message, encode
from s2rtools.simulated_frames.frame_folder import FrameFolder, prepare_folder
from s2rtools.simulated_frames.requested_poses import camera_poses

FRAMES = 100
WORKERS = (1, 2, 4)
OWN_SECONDS = 0.05
_SIZE = 640, 480
_LENS = Intrinsics(400.0, 400.0, 320.0, 240.0)
_DOMAIN = Domain("sim", "sim", _LENS, _LENS, 1.0, 0.0, 0.001, 1, 65534)


def figures(folder: Path) -> Iterator[BudgetRow]:
    """Overhead of one worker in percent, and the speed of several as a share of the ideal."""
    single = 0.0
    for count in WORKERS:
        seconds = render_seconds(folder / str(count), count, FRAMES * count)
        if count == 1:
            single = seconds
            overhead = 100 * (seconds / (FRAMES * OWN_SECONDS) - 1)
            yield BudgetRow("render: overhead beside 50 ms a frame", overhead, "%", 10)
        else:
            name = f"render: speed of {count} workers, share of {count} times that of one"
            yield BudgetRow(name, single / seconds, "1", 0.9, "at least")


def render_seconds(folder: Path, workers: int, frames: int) -> float:
    """Seconds from the first request to the last saved frame; all programs run already."""
    prepare_folder(folder)
    camera = Hello(width=_SIZE[0], height=_SIZE[1], fx=_LENS.fx, fy=_LENS.fy, cx=_LENS.cx,
                   cy=_LENS.cy, y_down=False, folder="")  # fmt: skip
    target = FrameFolder(folder, _DOMAIN, (_SIZE[1], _SIZE[0]), True)
    poses = camera_poses(np.random.default_rng(0).random((frames + workers, 3)), _DOMAIN, False)
    jobs = [RenderJob(number, pose, {}) for number, pose in enumerate(poses)]
    command = [sys.executable, "-m", "bench.rendering"]
    with RendererWorkers(command, camera, folder / "renderer", workers) as started:
        keys = [target.key(started.ready, pose, {}) for pose in poses]

        def save(number: int, frame: RenderedFrame) -> None:
            target.save(keys[number], frame, ("rgb", "depth"))

        results = started.render(jobs, save)
        for _ in range(workers):
            next(results)
        began = time.perf_counter()
        done = sum(not result.failure for result in results)
        seconds = time.perf_counter() - began
    if done != frames:
        raise RuntimeError(f"{frames - done} frames failed")
    return seconds


def main() -> None:
    """Be the renderer: write the same files for each frame, and answer after 50 ms."""
    rows, columns = np.mgrid[: _SIZE[1], : _SIZE[0]]
    image = np.stack([rows, columns, rows ^ columns], axis=2).astype(np.uint8)
    png = cv2.imencode(".png", image)[1].tobytes()
    npy = io.BytesIO()
    np.save(npy, (1 + (rows + columns) / 500).astype(np.float32))
    folder = Path()
    for line in sys.stdin.buffer:
        due = time.perf_counter() + OWN_SECONDS
        message = decode_message(line)
        answer = Answer(ready=Ready("bench", "1"))
        if message.hello is not None:
            folder = Path(message.hello.folder)
        elif message.render is not None:
            (folder / message.render.rgb).write_bytes(png)
            (folder / message.render.depth).write_bytes(npy.getvalue())
            time.sleep(max(0.0, due - time.perf_counter()))
            answer = Answer(rendered=Rendered(message.render.id))
        else:
            return
        sys.stdout.buffer.write(encode(answer))
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()

"""Render many frames with several processes of one renderer program."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import msgspec

from s2rtools.renderer.frames import RenderedFrame
from s2rtools.renderer.program import (
    FrameFailedError,
    RendererError,
    RendererProgram,
    RendererStoppedError,
)
from s2rtools.renderer.protocol import CameraPose, Hello, Ready, RenderRequest

_MOST_ATTEMPTS = 2
"""Starts of the program that one frame may cost, before it counts as failed."""
_MOST_RESTARTS = 3
"""Restarts of a program without a frame between them, before the whole run stops."""


@dataclass(frozen=True, slots=True)
class RenderJob:
    """A frame to render; `number` identifies it for the caller."""

    number: int
    pose: CameraPose
    parameters: dict[str, float]


@dataclass(frozen=True, slots=True)
class RenderResult:
    """A frame that is saved, or the reason why there is none."""

    number: int
    failure: str = ""


Save = Callable[[int, RenderedFrame], None]
"""Keeps the frame of a job's number; called by threads of the workers."""


class RendererWorkers:
    """Processes of one program; each is restarted where it ends or does not answer in time.

    A program that breaks the protocol is not restarted, because what it writes cannot be relied
    on.
    """

    def __init__(
        self, command: Sequence[str], camera: Hello, folder: Path, count: int = 1,
        timeout: float = 120.0,
    ) -> None:  # fmt: skip
        """Start the first process. Raises RendererError where it does not become ready.

        `folder` holds a folder and a log file of each process; `camera.folder` is ignored.
        """
        self._command, self._camera, self._folder = command, camera, folder
        self._count, self._timeout = count, timeout
        self._jobs: deque[tuple[RenderJob, int]] = deque()
        self._results: queue.SimpleQueue[RenderResult | BaseException | None] = queue.SimpleQueue()
        self._stopped = threading.Event()
        self._programs: dict[int, RendererProgram] = {}
        try:
            self.ready = self._start(0)
        except BaseException:
            self.close()
            raise

    def render(self, jobs: Sequence[RenderJob], save: Save) -> Generator[RenderResult, None, None]:
        """Render jobs in any order and yield the result of each.

        Raises RendererError where the program cannot be used any longer; frames that are saved
        stay.
        """
        self._jobs.extend((job, 1) for job in jobs)
        count = min(self._count, len(jobs))
        threads = [
            threading.Thread(target=self._work, args=(worker, save), daemon=True)
            for worker in range(count)
        ]
        for thread in threads:
            thread.start()
        try:
            while count:
                result = self._results.get()
                if result is None:
                    count -= 1
                elif isinstance(result, RenderResult):
                    yield result
                else:
                    raise result
        finally:
            if count:
                self._stopped.set()
                for program in list(self._programs.values()):
                    program.stop()
            for thread in threads:
                thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all processes."""
        for program in self._programs.values():
            program.close()
        self._programs.clear()

    def _start(self, worker: int) -> Ready:
        """Start the process of a worker, and wait until it is ready."""
        folder = self._folder / f"worker-{worker}"
        folder.mkdir(parents=True, exist_ok=True)
        camera = msgspec.structs.replace(self._camera, folder=str(folder.resolve()))
        log = self._folder / f"worker-{worker}.log"
        program = RendererProgram(self._command, camera, log, self._timeout)
        self._programs[worker] = program
        if self._stopped.is_set():
            program.stop()
        return program.greet()

    def _work(self, worker: int, save: Save) -> None:
        """Render until no job is left; restart the program where that may help."""
        restarts = 0
        try:
            while not self._stopped.is_set():
                try:
                    if worker not in self._programs and self._start(worker) != self.ready:
                        name = self._command[0]
                        raise RendererError(f"renderer {name}: declares other things at each start")
                    for result in self._render_on(self._programs[worker], save):
                        self._results.put(result)
                        restarts = restarts if result.failure else 0
                    break
                except RendererStoppedError as error:
                    self._programs.pop(worker).kill()
                    restarts += 1
                    if restarts > _MOST_RESTARTS:
                        times = f"restarted {_MOST_RESTARTS} times without a frame"
                        raise RendererError(f"{error}; {times}") from error
        except BaseException as error:
            self._results.put(error)
        finally:
            self._results.put(None)

    def _render_on(self, program: RendererProgram, save: Save) -> Iterator[RenderResult]:
        """Results of one process; the job of one that stops goes back, or counts as failed."""
        current = self._request_next(program)
        while current is not None and not self._stopped.is_set():
            job, attempt, request = current
            failure = ""
            try:
                program.wait(request)
            except FrameFailedError as error:
                failure = str(error) or "no reason is stated"
            except RendererStoppedError as error:
                if attempt < _MOST_ATTEMPTS:
                    self._jobs.appendleft((job, attempt + 1))
                else:
                    yield RenderResult(job.number, str(error))
                raise
            current = self._request_next(program)
            if not failure:
                save(job.number, program.frame(request))
            yield RenderResult(job.number, failure)

    def _request_next(
        self, program: RendererProgram
    ) -> tuple[RenderJob, int, RenderRequest] | None:
        """Request the next job; None where no job is left."""
        try:
            job, attempt = self._jobs.popleft()
        except IndexError:
            return None
        number, pose = job.number, job.pose
        request = RenderRequest(
            pose.x, pose.y, pose.heading, pose.position, pose.quaternion, id=number,
            parameters=job.parameters, rgb=f"{number}-rgb.png", depth=f"{number}-depth.npy",
        )  # fmt: skip
        program.request(request)
        return job, attempt, request

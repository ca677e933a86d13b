"""Render poses with the cameras of a domain by a renderer program, into a folder of frames."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.plugins import Registry, instance_of
from s2rstore.reader import Store
from s2rstore.records import Domain, Intrinsics
from s2rtools.renderer.frames import RenderedFrame
from s2rtools.renderer.program_pool import RendererWorkers, RenderJob
from s2rtools.renderer.protocol import Hello, Ready
from s2rtools.simulated_frames.frame_folder import FrameFolder, prepare_folder
from s2rtools.simulated_frames.requested_poses import Poses, camera_poses


@dataclass(frozen=True, slots=True)
class NamedRenderer:
    """A renderer program of Python: its module, and the option that takes the argument, if any."""

    module: str
    option: str = ""


RENDERERS = Registry[NamedRenderer](
    "renderer",
    {
        "world": NamedRenderer("s2rtools.renderer.world", "--seed"),
        "mesh": NamedRenderer("s2rtools.renderer.mesh"),
    },
    instance_of(NamedRenderer),
)
"""Renderers with a name, which stands before the colon of `--renderer NAME:ARGUMENT`."""
MOST_WORKERS = 64
_FILES = "renderer"
"""Folder of the programs' logs and of frames that are not checked yet."""


def renderer_command(text: str) -> list[str]:
    """The words of `--renderer`, as a shell splits them; no shell is used.

    A renderer of `RENDERERS` takes the place of its name. Raises RequestError for unbalanced
    quotes and for a program that does not exist.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise RequestError(f"--renderer {text}: {error}") from error
    if not words:
        raise RequestError("--renderer: names no program")
    kind, colon, argument = words[0].partition(":")
    if colon and kind in RENDERERS:
        named = RENDERERS[kind]
        option = [named.option] if named.option else []
        return [sys.executable, "-P", "-m", named.module, *option, argument, *words[1:]]
    if shutil.which(words[0]) is None:
        raise RequestError(f"--renderer {text}: there is no program {words[0]!r}")
    return words


def check_processes(workers: int, timeout: float) -> None:
    """Raise RequestError for a number of processes or a time limit in seconds out of range."""
    if not 1 <= workers <= MOST_WORKERS:
        raise RequestError(f"--workers {workers}: must be 1 to {MOST_WORKERS}")
    if not 0 < timeout < 1e6:
        raise RequestError(f"--timeout {timeout:g}: must be more than 0 seconds")


def frames_path(store: Path, out: Path | None) -> Path:
    """The folder of frames: `out`, or one beside the store.

    Raises RequestError where it lies inside the store.
    """
    path = out or store.with_name(f"{store.stem}-frames")
    if store.resolve() in path.resolve().parents:
        raise RequestError(f"--out {path}: lies inside the store")
    return path


def default_domain(store: Store) -> str:
    """The domain whose cameras render: the sim domain; in a store without one, the first."""
    kinds = {name: store.domain(name).kind for name in store.domains}
    return next((name for name, kind in kinds.items() if kind == "sim"), next(iter(kinds)))


@dataclass(frozen=True, slots=True)
class FrameCameras:
    """The cameras of a domain, for frames of (height, width) pixels."""

    domain: Domain
    frame: tuple[int, int]
    y_down: bool

    @classmethod
    def of_store(cls, store: Store, domain: str | None) -> Self:
        """The cameras of a domain, by default of `default_domain`."""
        return cls.of_domain(store, store.domain(domain or default_domain(store)))

    @classmethod
    def of_domain(cls, store: Store, domain: Domain) -> Self:
        """The cameras of a domain that a run may have moved."""
        dataset = store.dataset
        return cls(domain, (dataset.frame_height, dataset.frame_width), dataset.y_down)

    @property
    def lenses(self) -> list[tuple[Intrinsics, tuple[str, ...]]]:
        """Each camera with the images that it takes: one for both, or one for each."""
        domain = self.domain
        if not domain.has_depth or domain.depth == domain.rgb:
            return [(domain.rgb, ("rgb", "depth"))]
        return [(domain.rgb, ("rgb",)), (domain.depth, ("depth",))]

    def hello(self, lens: Intrinsics) -> Hello:
        """What a renderer is told about a camera."""
        return Hello(
            width=self.frame[1], height=self.frame[0], fx=lens.fx, fy=lens.fy, cx=lens.cx,
            cy=lens.cy, y_down=self.y_down, folder="",
        )  # fmt: skip


class PoseRenderer:
    """Processes of a renderer program, and the folder that keeps the frames they render.

    A frame that the folder has is not rendered again. Where RGB and depth have different cameras,
    each pose is rendered by both.
    """

    def __init__(
        self, path: Path, command: Sequence[str], cameras: FrameCameras, workers: int,
        timeout: float,
    ) -> None:  # fmt: skip
        """Start a process for each camera. Raises RequestError where it does not become ready.

        `workers` processes render at a time; each answer may take `timeout` seconds.
        """
        prepare_folder(path)
        self.cameras, self._files = cameras, path / _FILES
        with ExitStack() as stack:
            self._workers: list[RendererWorkers] = []
            for lens, images in cameras.lenses:
                files = self._files / images[0] if self._workers else self._files
                self._workers.append(stack.enter_context(
                    RendererWorkers(command, cameras.hello(lens), files, workers, timeout)
                ))  # fmt: skip
            self.ready: Ready = self._workers[0].ready
            has_depth = cameras.domain.has_depth and self.ready.depth
            self.folder = FrameFolder(path, cameras.domain, cameras.frame, has_depth)
            self._stack = stack.pop_all()

    def keys(self, poses: Poses, values: Sequence[Mapping[str, float]]) -> list[str]:
        """The key of each frame in the folder, by its pose (n, 3) and parameter values (n)."""
        cameras = camera_poses(poses, self.cameras.domain, self.cameras.y_down)
        return [
            self.folder.key(self.ready, pose, dict(each))
            for pose, each in zip(cameras, values, strict=True)
        ]

    def render(
        self, poses: Poses, values: Sequence[Mapping[str, float]],
        begin: Callable[[str, int], None] = lambda stage, total: None,
        advance: Callable[[int], None] = lambda steps: None,
    ) -> dict[int, str]:  # fmt: skip
        """Render the frames that the folder lacks; return the reasons of those that failed, by row.

        Raises RequestError where the program cannot be used any longer; frames so far stay.
        """
        failures: dict[int, str] = {}
        keys, domain = self.keys(poses, values), self.cameras.domain
        for workers, (lens, images) in zip(self._workers, self.cameras.lenses, strict=True):
            wanted = [each for each in images if each == "rgb" or self.folder.has_depth]
            placed = camera_poses(poses, replace(domain, rgb=lens), self.cameras.y_down)
            jobs = [
                RenderJob(number, pose, dict(each))
                for number, (key, pose, each) in enumerate(zip(keys, placed, values, strict=True))
                if wanted and number not in failures and not self.folder.has(key, *wanted)
            ]
            begin(f"render {' and '.join(wanted)}", len(jobs))
            save = partial(self._save, keys, images)
            with closing(workers.render(jobs, save)) as results:
                for result in results:
                    advance(1)
                    if result.failure:
                        failures[result.number] = result.failure
        return failures

    def images(
        self, poses: Poses, values: Sequence[Mapping[str, float]]
    ) -> dict[str, NDArray[Any]]:
        """RGB (n, height, width, 3) and depth (n, height, width) of rendered frames.

        Depth is in the units of the domain, 0 where there is none.
        """
        frames = [self.folder.read(key) for key in self.keys(poses, values)]
        rgb, depth = (np.stack(each) for each in zip(*frames, strict=True))
        return {"rgb": rgb, "depth": depth}

    def _save(
        self, keys: list[str], images: tuple[str, ...], number: int, frame: RenderedFrame
    ) -> None:
        self.folder.save(keys[number], frame, images)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes and delete what they wrote beside their logs."""
        self._stack.close()
        for folder in list(self._files.rglob("worker-*/")):
            shutil.rmtree(folder, ignore_errors=True)

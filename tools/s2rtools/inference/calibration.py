"""Backends by name, and the measured choice of the fastest one that is accurate enough."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.inference.backend import Backend, Bfloat16Backend
from s2rtools.inference.cuda_backend import CudaBackend, CudaBfloat16Backend, CudaFloat16Backend
from s2rtools.inference.openvino_backend import OpenVinoBackend, OpenVinoFloat32Backend
from s2rtools.inference.winograd_backend import WinogradBackend
from s2rtools.models.pose_network import LoadedModel

TOLERANCE_METRES = 0.01
TOLERANCE_RADIANS = float(np.radians(0.5))
SPEED_MARGIN = 1.15
"""By this factor a backend must be faster than one that was measured before it."""
SLOWEST = 2.0
"""Backends that take longer than this, relative to float32, are not measured any further."""

BACKENDS: dict[str, type[Backend]] = {
    backend.name: backend
    for backend in (
        Backend, WinogradBackend, OpenVinoFloat32Backend, OpenVinoBackend, Bfloat16Backend,
        CudaBackend, CudaFloat16Backend, CudaBfloat16Backend,
    )
}  # fmt: skip
"""By name; float32 comes first on each device, so that it is kept where others save little."""
AUTO = "auto"
BACKEND_NAMES = (AUTO, *BACKENDS)
_ROUNDS = 3


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredBackend:
    """A backend with its speed, relative to torch in float32, and its largest deviations from it.

    `metres` and `radians` are the largest differences of the predicted poses on the sample.
    """

    backend: Backend
    speed: float
    metres: float
    radians: float

    @property
    def accurate(self) -> bool:
        return self.metres <= TOLERANCE_METRES and self.radians <= TOLERANCE_RADIANS


def open_backend(model: LoadedModel, name: str, threads: int = 0) -> Backend:
    """Open a backend by name. Raises RequestError for unknown and unavailable ones."""
    if name not in BACKENDS:
        raise RequestError(f"backend {name!r}: one of {', '.join(BACKEND_NAMES)}")
    reason = BACKENDS[name].unavailable_reason()
    if reason is not None:
        raise RequestError(f"backend {name!r} {reason}")
    return BACKENDS[name](model, threads)


def open_float32(model: LoadedModel, threads: int = 0) -> Backend:
    """torch in float32, on the GPU where there is one."""
    kind = Backend if CudaBackend.unavailable_reason() else CudaBackend
    return kind(model, threads)


def choose_backend(
    model: LoadedModel, sample: NDArray[np.float32], name: str = AUTO, threads: int = 0
) -> MeasuredBackend:
    """The named backend, if it deviates at most 1 cm and 0.5 degrees from float32 on the sample.

    `auto` is the fastest such backend of this machine, among those of the GPU where there is one.
    `sample` (B, C, h, w). Raises RequestError if a backend requested by name deviates too far or
    is not available. A network without accessible features runs in torch float32 only.
    """
    if name == AUTO:
        return _fastest(model, sample, threads)
    if name == Backend.name or not model.network.has_features:
        return MeasuredBackend(open_backend(model, name, threads), 1.0, 0.0, 0.0)
    backend = open_backend(model, name, threads)
    (measured,) = measure_backends(model, sample, [backend], threads, float("inf"))
    if not measured.accurate:
        raise RequestError(
            f"backend {name}: off by {measured.metres:.3f} m and "
            f"{np.degrees(measured.radians):.2f} degrees on a calibration batch; "
            "use --backend torch"
        )
    return measured


def _fastest(model: LoadedModel, sample: NDArray[np.float32], threads: int) -> MeasuredBackend:
    best = MeasuredBackend(Backend(model, threads), 1.0, 0.0, 0.0)
    if not model.network.has_features or not len(sample):
        return best
    gpu = CudaBackend.unavailable_reason() is None
    candidates = [
        open_backend(model, name, threads)
        for name, kind in BACKENDS.items()
        if kind is not Backend
        and kind.unavailable_reason() is None
        and kind.suits(model)
        and issubclass(kind, CudaBackend) == gpu
    ]
    for measured in measure_backends(model, sample, candidates, threads):
        if measured.accurate and measured.speed > SPEED_MARGIN * best.speed:
            best = measured
    return best


def measure_backends(
    model: LoadedModel,
    sample: NDArray[np.float32],
    backends: Sequence[Backend],
    threads: int = 0,
    slowest: float = SLOWEST,
) -> list[MeasuredBackend]:
    """Deviation and speed of backends against torch in float32 on the sample.

    The backends take turns, so that a load of the machine that changes meanwhile affects all;
    that batch counts which takes the shortest time per image, of at least three. One that takes
    more than `slowest` times as long for one image is left out.
    """
    reference = Backend(model, threads)
    limit = slowest * _seconds_per_image(reference, sample)
    backends = [backend for backend in backends if _seconds_per_image(backend, sample) <= limit]
    every = [reference, *backends]
    size = max(backend.batch for backend in every)
    batches = [sample[start : start + size] for start in range(0, len(sample), size)]
    found: list[list[NDArray[np.float64]]] = [[] for _ in every]
    seconds = np.full(len(every), np.inf)
    for turn in range(max(_ROUNDS, len(batches))):
        images = batches[turn % len(batches)]
        for number, backend in enumerate(every):
            began = time.perf_counter()
            found[number].append(_poses(backend, images))
            taken = (time.perf_counter() - began) / len(images)
            seconds[number] = min(seconds[number], taken)
    poses = [np.concatenate(parts[: len(batches)]) for parts in found]
    return [
        MeasuredBackend(backend, float(seconds[0] / taken), *_deviation(predicted, poses[0]))
        for backend, taken, predicted in zip(backends, seconds[1:], poses[1:], strict=True)
    ]


def _seconds_per_image(backend: Backend, sample: NDArray[np.float32]) -> float:
    """Time of one image, the faster of two after a first one."""
    seconds = []
    for _ in range(_ROUNDS):
        began = time.perf_counter()
        backend.forward_all(sample[:1])
        seconds.append(time.perf_counter() - began)
    return min(seconds[1:])


def _poses(backend: Backend, sample: NDArray[np.float32]) -> NDArray[np.float64]:
    starts = range(backend.batch, len(sample), backend.batch)
    return np.concatenate([backend.forward_all(x).pose for x in np.split(sample, starts)])


def _deviation(poses: NDArray[np.float64], expected: NDArray[np.float64]) -> tuple[float, float]:
    """Largest differences of poses (B, 3), in metres and radians."""
    metres = np.hypot(*(poses[:, :2] - expected[:, :2]).T).max()
    return float(metres), float(angles.distance(poses[:, 2], expected[:, 2]).max())

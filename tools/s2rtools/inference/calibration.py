"""Backends by name, and the choice of one that this machine has and that is accurate enough."""

from __future__ import annotations

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
BACKENDS: dict[str, type[Backend]] = {
    backend.name: backend
    for backend in (
        Backend, WinogradBackend, OpenVinoFloat32Backend, OpenVinoBackend, Bfloat16Backend,
        CudaBackend, CudaFloat16Backend, CudaBfloat16Backend,
    )
}  # fmt: skip
AUTO = "auto"
BACKEND_NAMES = (AUTO, *BACKENDS)

PREFERENCE: tuple[type[Backend], ...] = (
    CudaFloat16Backend, CudaBackend, OpenVinoBackend, OpenVinoFloat32Backend, Bfloat16Backend,
)  # fmt: skip
"""Backends of `auto`, the fastest first; torch in float32 where this machine has none of them.

The order is that of measurements, so that the load of a machine has no influence on its choice.
"""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredBackend:
    """A backend with its largest deviations from torch in float32.

    `metres` and `radians` are the largest differences of the predicted poses on the sample.
    """

    backend: Backend
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

    `auto` is the first of `PREFERENCE` that this machine accelerates and that is as accurate, else
    torch in float32. `sample` (B, C, h, w). Raises RequestError if a backend requested by name
    deviates too far or is not available. A network without accessible features runs in torch
    float32 only.
    """
    if name == AUTO:
        return _preferred(model, sample, threads)
    backend = open_backend(model, name, threads)
    if name == Backend.name or not model.network.has_features:
        return MeasuredBackend(backend, 0.0, 0.0)
    measured = measure_backend(model, sample, backend, threads)
    if not measured.accurate:
        raise RequestError(
            f"backend {name}: off by {measured.metres:.3f} m and "
            f"{np.degrees(measured.radians):.2f} degrees on a calibration batch; "
            "use --backend torch"
        )
    return measured


def _preferred(model: LoadedModel, sample: NDArray[np.float32], threads: int) -> MeasuredBackend:
    if model.network.has_features and len(sample):
        for kind in PREFERENCE:
            if kind.is_accelerated() and kind.suits(model):
                measured = measure_backend(model, sample, kind(model, threads), threads)
                if measured.accurate:
                    return measured
    return MeasuredBackend(Backend(model, threads), 0.0, 0.0)


def measure_backend(
    model: LoadedModel, sample: NDArray[np.float32], backend: Backend, threads: int = 0
) -> MeasuredBackend:
    """Deviation of a backend from torch in float32 on the sample."""
    expected = _poses(Backend(model, threads), sample)
    return MeasuredBackend(backend, *_deviation(_poses(backend, sample), expected))


def _poses(backend: Backend, sample: NDArray[np.float32]) -> NDArray[np.float64]:
    starts = range(backend.batch, len(sample), backend.batch)
    return np.concatenate([backend.forward_all(x).pose for x in np.split(sample, starts)])


def _deviation(poses: NDArray[np.float64], expected: NDArray[np.float64]) -> tuple[float, float]:
    """Largest differences of poses (B, 3), in metres and radians."""
    metres = np.hypot(*(poses[:, :2] - expected[:, :2]).T).max()
    return float(metres), float(angles.distance(poses[:, 2], expected[:, 2]).max())

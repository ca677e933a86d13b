"""Backends: the forward pass of a model in a chosen library and precision."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.inference.batch_norm_folding import fold_batch_norm
from s2rtools.models.pose_network import LoadedModel
from s2rtools.models.torchscript import last_line

BATCH = 8
TOLERANCE_METRES = 0.01
TOLERANCE_RADIANS = float(np.radians(0.5))


@dataclass(frozen=True, slots=True, eq=False)
class ForwardOutput:
    """x (B, 4, h, w) and features (B, C, fh, fw) as tensors; embedding (B, D) and pose (B, 3).

    `features` is None for a network without accessible features.
    """

    x: Tensor
    features: Tensor | None
    embedding: Tensor
    pose: NDArray[np.float64]


class Backend:
    """torch in float32, on the GPU if available; deterministic."""

    name = "torch"
    precision = "float32"
    batch = BATCH
    uses_gpu = True

    def __init__(self, model: LoadedModel, threads: int = 0) -> None:
        """`threads` 0 keeps torch's setting."""
        if threads:
            torch.set_num_threads(threads)
        self.model = model
        self.device = torch.device("cuda" if self.uses_gpu and torch.cuda.is_available() else "cpu")
        if self.device.type == "cuda":
            torch.backends.cudnn.allow_tf32 = False
            torch.backends.cuda.matmul.allow_tf32 = False
        self.trunk: nn.Module | None = None
        if model.network.has_features:
            self.trunk = fold_batch_norm(model.network.trunk).to(self.device)
        model.network.to(self.device)

    def features(self, x: Tensor) -> Tensor:
        """Trunk features in float32."""
        if self.trunk is None:
            raise RequestError(f"model {self.model.name!r} has no accessible feature maps")
        x = x.to(self.device).contiguous(memory_format=torch.channels_last)
        return self.trunk(x).float()

    def pose(self, raw: Tensor) -> NDArray[np.float64]:
        """Decoded poses (B, 3) in metres, metres, radians."""
        return self.model.convention.decode(raw.double()).cpu().numpy()

    def forward_all(self, x: NDArray[np.float32]) -> ForwardOutput:
        """Results of one forward pass over a batch of inputs."""
        with torch.inference_mode():
            tensor = torch.from_numpy(x).to(self.device)
            if self.trunk is None:
                raw = self._opaque_output(tensor)
                return ForwardOutput(tensor, None, raw, self.pose(raw))
            features = self.features(tensor)
            embedding = self.model.network.embed(features)
            raw = self.model.network.head(embedding)
            for name, values in (("features", features), ("embeddings", embedding)):
                if len(values) != len(tensor):
                    raise self._error(f"returns {len(values)} {name} for {len(tensor)} images")
            return ForwardOutput(tensor, features, embedding, self.pose(self._checked(raw, tensor)))

    def _opaque_output(self, x: Tensor) -> Tensor:
        """Checked output of a network without accessible features."""
        try:
            raw: object = self.model.network(x)
        except Exception as error:  # the module's code may raise anything
            raise self._error(f"fails on {len(x)} images: {last_line(error)}") from error
        return self._checked(raw, x)

    def _checked(self, raw: object, x: Tensor) -> Tensor:
        """The raw output, if its shape fits the batch and the convention."""
        expected = len(x), self.model.convention.width
        if not isinstance(raw, Tensor):
            raise self._error(f"returns {type(raw).__name__}, not a tensor")
        shape = tuple(raw.shape)
        if shape != expected:
            raise self._error(f"returns {shape} for {len(x)} images, expected {expected}")
        return raw

    def _error(self, reason: str) -> RequestError:
        return RequestError(f"model {self.model.name!r}: {reason}; export it for any batch size")


class Bfloat16Backend(Backend):
    """torch with the trunk in bfloat16; pooling and linear layers in float32."""

    name = "torch-bfloat16"
    precision = "bfloat16"

    def __init__(self, model: LoadedModel, threads: int = 0) -> None:
        super().__init__(model, threads)
        if self.trunk is not None:
            self.trunk = self.trunk.to(torch.bfloat16)

    def features(self, x: Tensor) -> Tensor:
        return super().features(x.to(torch.bfloat16))


class OpenVinoBackend(Backend):
    """OpenVINO on the CPU in its preferred precision; needs the package `openvino`."""

    name = "openvino"
    precision = "openvino"
    uses_gpu = False

    def __init__(self, model: LoadedModel, threads: int = 0) -> None:
        super().__init__(model, threads)
        import openvino

        if self.trunk is None:
            raise RequestError(
                f"model {self.model.name!r}: a network without features runs on torch only"
            )
        example = torch.zeros(1, 4, *model.network.input_size)
        converted = openvino.convert_model(self.trunk, example_input=example)
        options: dict[str, Any] = {"INFERENCE_NUM_THREADS": threads} if threads else {}
        self._compiled = openvino.compile_model(converted, "CPU", options)
        kind = self._compiled.get_property("INFERENCE_PRECISION_HINT")
        self.precision = f"openvino {kind.get_type_name()}"

    def features(self, x: Tensor) -> Tensor:
        output = self._compiled([x.contiguous().numpy()])[0]
        return torch.from_numpy(np.array(output, dtype=np.float32))


BACKENDS: dict[str, type[Backend]] = {
    backend.name: backend for backend in (Backend, Bfloat16Backend, OpenVinoBackend)
}
BACKEND_NAMES = ("auto", *BACKENDS)


def open_backend(model: LoadedModel, name: str, threads: int = 0) -> Backend:
    """Open a backend by name. Raises RequestError for unknown names and missing packages."""
    if name not in BACKENDS:
        raise RequestError(f"backend {name!r}: one of {', '.join(BACKEND_NAMES)}")
    try:
        return BACKENDS[name](model, threads)
    except ImportError as error:
        raise RequestError(
            f"backend {name!r} needs {error.name}: pip install {error.name}"
        ) from error


def choose_backend(
    model: LoadedModel, sample: NDArray[np.float32], name: str = "torch", threads: int = 0
) -> Backend:
    """The named backend, if it deviates at most 1 cm and 0.5 degrees from float32 on the sample.

    `auto` chooses torch on a GPU, else the first of OpenVINO and bfloat16 that is installed and
    accurate enough. `sample` (B, 4, h, w). Raises RequestError if a backend requested by name
    deviates too far.
    """
    reference = Backend(model, threads)
    on_gpu = name == "auto" and reference.device.type == "cuda"
    if name == Backend.name or on_gpu or not model.network.has_features:
        return reference
    expected = reference.forward_all(sample).pose
    for candidate in (OpenVinoBackend.name, Bfloat16Backend.name) if name == "auto" else (name,):
        try:
            backend = open_backend(model, candidate, threads)
        except RequestError:
            if name == "auto":
                continue
            raise
        pose = backend.forward_all(sample).pose
        metres = float(np.hypot(*(pose[:, :2] - expected[:, :2]).T).max())
        radians = float(angles.distance(pose[:, 2], expected[:, 2]).max())
        if metres <= TOLERANCE_METRES and radians <= TOLERANCE_RADIANS:
            return backend
        if name != "auto":
            raise RequestError(
                f"backend {name}: off by {metres:.3f} m and {np.degrees(radians):.2f} degrees on a "
                "calibration batch; use --backend torch"
            )
    return Backend(model, threads)

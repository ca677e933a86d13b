"""The backends that compute a run, as its provenance and the keys of its arrays state them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec

from s2rstore.errors import RequestError
from s2rtools.counterfactual import gap_shares
from s2rtools.heatmaps.harm import Harm
from s2rtools.heatmaps.occlusion import Occlusion
from s2rtools.inference import Backend, open_backend
from s2rtools.inference.backend import is_float32
from s2rtools.inference.calibration import BACKENDS
from s2rtools.inference.cuda_backend import CudaBackend
from s2rtools.inference.winograd_backend import WinogradBackend
from s2rtools.models.pose_network import LoadedModel

Differences = Literal["float32", "bfloat16", "bfloat16-broad"]
FLOAT32: Differences = "float32"
REDUCED_DIFFERENCES: tuple[Differences, ...] = ("bfloat16-broad", "bfloat16")
"""Precisions of differences below float32, the fastest first."""
_OF_CHANGED_INPUTS = (Harm.name, gap_shares.KIND)
"""Kinds made of poses of changed inputs, which float32 backends of predictions compute, too."""


@dataclass(frozen=True, slots=True)
class BackendIdentity:
    """Name and precision of a backend, as keys of arrays contain them."""

    name: str
    precision: str

    @classmethod
    def of(cls, backend: Backend) -> BackendIdentity:
        return cls(backend.name, backend.precision)

    @property
    def label(self) -> str:
        """Library or device and precision, such as `openvino bf16`."""
        return f"{self.name.partition('-')[0]} {self.precision.rpartition(' ')[2]}"

    @property
    def uses_gpu(self) -> bool:
        return issubclass(BACKENDS.get(self.name, Backend), CudaBackend)

    @property
    def keeps_activations(self) -> bool:
        """Whether a forward pass keeps the outputs of all operations of the trunk."""
        return issubclass(BACKENDS.get(self.name, Backend), WinogradBackend)

    def facts(self) -> dict[str, str]:
        return {"name": self.name, "precision": self.precision}

    def open(self, model: LoadedModel, threads: int) -> Backend:
        """Raises RequestError if this machine does not have the backend in this precision."""
        backend = open_backend(model, self.name, threads)
        if BackendIdentity.of(backend) != self:
            raise RequestError(
                f"model {model.name!r}: arrays of this run were computed in {self.precision}, this "
                f"machine offers {backend.precision}; --backend torch computes all of them again"
            )
        return backend


@dataclass(frozen=True, slots=True)
class RunBackends:
    """What computes a run: predictions and embeddings, heatmaps, and differences in occlusion.

    `differences` is None as long as no occlusion of the run was planned. `facts` are the measured
    properties, for the provenance.
    """

    predictions: BackendIdentity
    heatmaps: BackendIdentity
    differences: Differences | None = None
    facts: dict[str, Any] = field(default_factory=dict, compare=False)

    @classmethod
    def from_record(cls, record: dict[str, Any], where: str) -> RunBackends:
        """From the provenance of a run.

        Raises RequestError, which begins with `where`, for a malformed record.
        """
        try:
            return msgspec.convert(record, cls)
        except msgspec.ValidationError as error:
            raise RequestError(f"{where}: the backend is not valid ({error})") from error

    @property
    def heatmaps_reuse_activations(self) -> bool:
        """Whether heatmaps can reuse the outputs that the forward pass of the predictions keeps."""
        return self.predictions == self.heatmaps and self.predictions.keeps_activations

    def record(self) -> dict[str, Any]:
        """For the provenance of a run."""
        record: dict[str, Any] = msgspec.to_builtins(self)
        return record

    def kind_facts(self, kind: str) -> dict[str, str]:
        """What the key of a heatmap kind's arrays contains of the backend."""
        facts = self.heatmaps.facts()
        if kind == Occlusion.name and self.differences not in (None, FLOAT32):
            facts["differences"] = str(self.differences)
        if kind in _OF_CHANGED_INPUTS and is_float32(self.predictions.precision):
            facts["poses"] = self.predictions.name
        return facts

    def open(self, model: LoadedModel, threads: int) -> tuple[Backend, Backend]:
        """The backends of predictions and of heatmaps. Raises RequestError, see `BackendIdentity`.

        They are one object where they are the same.
        """
        predictions = heatmaps = self.predictions.open(model, threads)
        if self.heatmaps != self.predictions:
            heatmaps = self.heatmaps.open(model, threads)
        heatmaps.differences = self.differences or FLOAT32
        return predictions, heatmaps

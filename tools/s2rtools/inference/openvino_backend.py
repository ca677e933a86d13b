"""Backends of OpenVINO on the processor; they need the package `openvino`."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np
import torch
from torch import Tensor

from s2rstore.errors import RequestError
from s2rtools.inference.backend import Backend
from s2rtools.models.pose_network import LoadedModel

_TELEMETRY = "openvino_telemetry"
_CONVERTED: WeakKeyDictionary[Any, dict[tuple[int, ...], Any]] = WeakKeyDictionary()
"""Converted trunks by network and shape of its input; each precision compiles the same one."""


class OpenVinoBackend(Backend):
    """OpenVINO in the precision that it prefers here: bfloat16 if the processor supports it.

    Its threads are not pinned: each of several processes would pin its own to the same processor.
    """

    name = "openvino"
    library = "openvino"
    hint: ClassVar[str | None] = None

    def __init__(self, model: LoadedModel, threads: int = 0) -> None:
        super().__init__(model, threads)
        openvino = _import_openvino()
        if self.trunk is None:
            raise RequestError(
                f"model {self.model.name!r}: a network without features runs on torch only"
            )
        converted = _CONVERTED.setdefault(model.network, {})
        shape = model.contract.shape
        if shape not in converted:
            example = torch.zeros(1, *shape)
            converted[shape] = openvino.convert_model(self.trunk, example_input=example)
        options: dict[str, Any] = {"ENABLE_CPU_PINNING": False}
        if threads:
            options["INFERENCE_NUM_THREADS"] = threads
        if self.hint is not None:
            options["INFERENCE_PRECISION_HINT"] = self.hint
        self._compiled = _call_in_thread(openvino.compile_model, converted[shape], "CPU", options)
        kind = self._compiled.get_property("INFERENCE_PRECISION_HINT")
        self.precision = f"openvino {kind.get_type_name()}"

    @classmethod
    def unavailable_reason(cls) -> str | None:
        if importlib.util.find_spec("openvino") is None:
            return "needs the package openvino: pip install openvino"
        return None

    @classmethod
    def is_accelerated(cls) -> bool:
        """Whether OpenVINO computes in reduced precision here; else it is `openvino-float32`."""
        if cls.unavailable_reason() is not None:
            return False
        core = _import_openvino().Core()
        return "BF16" in _call_in_thread(core.get_property, "CPU", "OPTIMIZATION_CAPABILITIES")

    def features(self, x: Tensor) -> Tensor:
        output = self._compiled([x.contiguous().numpy()])[0]
        return torch.from_numpy(np.array(output, dtype=np.float32))


class OpenVinoFloat32Backend(OpenVinoBackend):
    """OpenVINO in float32."""

    name = "openvino-float32"
    hint = "f32"

    @classmethod
    def is_accelerated(cls) -> bool:
        return cls.unavailable_reason() is None


def _call_in_thread(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function that loads OpenVINO's plug-in of the processor in a thread of its own.

    The plug-in replaces the alternate signal stack of the thread that loads it, and frees the new
    one in the thread that destroys the model. Another thread would be left with freed memory, and
    its next signal would end the process.
    """
    with ThreadPoolExecutor(1) as executor:
        return executor.submit(function, *arguments).result()


def _import_openvino() -> ModuleType:
    """The package, imported without its usage statistics, which it would send to its makers."""
    blocked = _TELEMETRY not in sys.modules
    if blocked:
        sys.modules[_TELEMETRY] = None  # type: ignore[assignment]
    try:
        import openvino
    finally:
        if blocked:
            del sys.modules[_TELEMETRY]
    module: ModuleType = openvino
    return module

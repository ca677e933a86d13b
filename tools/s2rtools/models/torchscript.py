"""Networks without accessible features: TorchScript archives and arbitrary modules."""

from __future__ import annotations

import io
from typing import ClassVar

import torch
from torch import Tensor, nn

from s2rstore.errors import RequestError
from s2rtools.models.conventions import OutputConvention
from s2rtools.models.pose_network import PoseNetwork

TORCHSCRIPT = "torchscript"
DEFAULT_INPUT_SIZE = (256, 256)
_MAX_SIDE = 2048


class OpaqueNetwork(PoseNetwork):
    """A module without accessible features; its raw output serves as its embedding.

    The module takes (B, 4, h, w) and returns (B, 3) or (B, 4), or a tuple that begins with it. Its
    attribute `input_size` = (h, w) is optional, by default 256 x 256.
    """

    architecture: ClassVar[str] = "opaque"
    has_features = False

    def __init__(self, module: nn.Module) -> None:
        """Raises RequestError if the module returns no pose for a black image."""
        super().__init__()
        self.input_size = _input_size(module)
        self.inner = module.eval()
        self.embedding_size = self._outputs()
        self.convention = OutputConvention("cos_sin" if self.embedding_size == 4 else "degrees")

    @classmethod
    def from_torchscript(cls, content: bytes, where: str) -> OpaqueNetwork:
        """Load an archive; `where` names it in a RequestError."""
        try:
            module = torch.jit.load(io.BytesIO(content), "cpu")
            return cls(module)
        except RuntimeError as error:
            raise RequestError(
                f"{where}: not a usable TorchScript archive ({last_line(error)})"
            ) from error

    def forward(self, x: Tensor) -> Tensor:
        output = self.inner(x)
        pose: Tensor = output[0] if isinstance(output, tuple | list) else output
        return pose

    def _outputs(self) -> int:
        try:
            with torch.inference_mode():
                output = self(torch.zeros(1, 4, *self.input_size))
        except Exception as error:  # the module's code may raise anything
            shape = f"(1, 4, {self.input_size[0]}, {self.input_size[1]})"
            raise RequestError(f"network: fails on {shape}: {last_line(error)}") from error
        is_row = isinstance(output, Tensor) and output.ndim == 2 and len(output) == 1
        if not is_row or output.shape[1] not in (3, 4):
            result = (
                str(tuple(output.shape)) if isinstance(output, Tensor) else type(output).__name__
            )
            raise RequestError(f"network: returns {result}, expected (1, 3) or (1, 4)")
        return int(output.shape[1])


def _input_size(module: nn.Module) -> tuple[int, int]:
    """(h, w) that the module declares, or the default."""
    try:
        height, width = getattr(module, "input_size", DEFAULT_INPUT_SIZE)
        size = int(height), int(width)
    except (TypeError, ValueError) as error:
        raise RequestError(f"network: input_size must be (height, width): {error}") from error
    if not all(1 <= side <= _MAX_SIDE for side in size):
        raise RequestError(f"network: input_size {size}: 1 .. {_MAX_SIDE} pixels a side")
    return size


def last_line(error: Exception) -> str:
    """The last line of an exception's message, which names the cause; its type if it is empty."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[-1].strip()[:160] if lines else type(error).__name__

"""Networks without accessible features: archives of torch and arbitrary modules."""

from __future__ import annotations

import io
from types import MethodType
from typing import ClassVar

import torch
from torch import Tensor, nn

from s2rstore.errors import RequestError
from s2rstore.records import ARCHIVES
from s2rtools.models.conventions import OutputConvention
from s2rtools.models.input_check import last_line, output_width
from s2rtools.models.input_contract import MAX_SIDE, InputContract, InputOverride
from s2rtools.models.pose_network import PoseNetwork

TORCHSCRIPT, EXPORTED = ARCHIVES
DEFAULT_INPUT_SIZE = (256, 256)


class OpaqueNetwork(PoseNetwork):
    """A module without accessible features; its raw output serves as its embedding.

    The module takes (B, C, h, w) as the input contract states and returns (B, 3) or (B, 4), or a
    tuple that begins with it. Its attribute `input_size` = (h, w) is optional, by default
    256 x 256; a contract overrides it.
    """

    architecture: ClassVar[str] = "opaque"
    has_features = False

    def __init__(
        self,
        module: nn.Module,
        contract: InputContract | None = None,
        override: InputOverride | None = None,
        where: str = "network",
    ) -> None:
        """`contract` is the registered one; `override` changes what the module declares.

        Raises RequestError, which begins with `where`, if the module returns no pose for an image.
        """
        super().__init__()
        declared = contract or InputContract(size=_input_size(module))
        self._contract = override.applied(declared) if override else declared
        self.input_size = self._contract.size
        self.inner = module
        self.embedding_size = output_width(module, self._contract, where, override)
        self.convention = OutputConvention("cos_sin" if self.embedding_size == 4 else "degrees")

    @classmethod
    def from_archive(
        cls,
        architecture: str,
        content: bytes,
        where: str,
        contract: InputContract | None = None,
        override: InputOverride | None = None,
    ) -> OpaqueNetwork:
        """Load an archive of torch, which executes code; `where` names it in a RequestError."""
        module = _loaded_script if architecture == TORCHSCRIPT else _loaded_export
        try:
            return cls(module(content), contract, override, where)
        except RequestError:
            raise
        except Exception as error:  # torch raises many types for files that it cannot read
            kind = "TorchScript" if architecture == TORCHSCRIPT else "torch.export"
            raise RequestError(
                f"{where}: not a usable {kind} archive ({last_line(error)})"
            ) from error

    @property
    def contract(self) -> InputContract:
        return self._contract

    def forward(self, x: Tensor) -> Tensor:
        output = self.inner(x)
        pose: Tensor = output[0] if isinstance(output, tuple | list) else output
        return pose


def _loaded_script(content: bytes) -> nn.Module:
    module: nn.Module = torch.jit.load(io.BytesIO(content), "cpu")
    return module.eval()


def _loaded_export(content: bytes) -> nn.Module:
    """The module of an exported program, which has one mode: that in which it was exported."""
    module: nn.Module = torch.export.load(io.BytesIO(content)).module()
    module.train = MethodType(lambda self, mode=True: self, module)  # type: ignore[method-assign]
    return module


def _input_size(module: nn.Module) -> tuple[int, int]:
    """(h, w) that the module declares, or the default."""
    try:
        height, width = getattr(module, "input_size", DEFAULT_INPUT_SIZE)
        size = int(height), int(width)
    except (TypeError, ValueError) as error:
        raise RequestError(f"network: input_size must be (height, width): {error}") from error
    if not all(1 <= side <= MAX_SIDE for side in size):
        raise RequestError(f"network: input_size {size}: 1 .. {MAX_SIDE} pixels a side")
    return size

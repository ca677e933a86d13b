"""What computes the values of an array.

Floating-point results depend on the device, the precision, the libraries and the number of threads,
so all values of one array come from one environment.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

_TEXT = Annotated[str, msgspec.Meta(max_length=200)]
_LIBRARIES = 32


class ComputeEnvironment(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Device (model of the processor or GPU), precision, threads, and versions of libraries."""

    device: _TEXT
    precision: _TEXT
    threads: Annotated[int, msgspec.Meta(ge=1, le=2**16)]
    versions: Annotated[dict[_TEXT, _TEXT], msgspec.Meta(max_length=_LIBRARIES)]

    def difference(self, other: ComputeEnvironment) -> str:
        """In which respects this environment is another one than `other`; empty where in none."""
        if self == other:
            return ""
        parts = [
            f"{name} {mine} instead of {theirs}"
            for name in ("device", "precision", "threads")
            if (mine := getattr(self, name)) != (theirs := getattr(other, name))
        ]
        for name in sorted(self.versions.keys() | other.versions.keys()):
            mine, theirs = self.versions.get(name, "none"), other.versions.get(name, "none")
            if mine != theirs:
                parts.append(f"{name} {mine} instead of {theirs}")
        return ", ".join(parts)

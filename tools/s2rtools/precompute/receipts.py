"""The record that an executor returns for each computed unit."""

from __future__ import annotations

import msgspec

from s2rstore.files.compute_environment import ComputeEnvironment


class Receipt(msgspec.Struct, frozen=True):
    """A unit whose result was written under a unique name and is not used yet.

    `unit` is the file that the result shall become, `path` the one that was written, both inside
    the store. `sha256` is that of the result's chunks, as its header states it, `bytes` the size of
    the whole file. `seconds` were taken on `host`, in `environment`: its device, precision, threads
    and versions of libraries.
    """

    unit: str
    path: str
    bytes: int
    sha256: str
    seconds: float
    host: str
    environment: ComputeEnvironment

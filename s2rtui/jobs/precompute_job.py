"""Save adjustments as a run: register it and compute it in a subprocess.

The subprocess is `s2r precompute`, so the run equals one made on the command line, and a later
precompute continues it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files import locks
from s2rstore.geometry.camera_offset import UNCHANGED
from s2rstore.records import SIDES, Side
from s2rstore.run_inputs import run_render_change
from s2rtui.jobs.command_job import CommandJob

_STAGES = 3
"""Stages that precompute reports for a run; one more if cameras are moved."""

Chains = Mapping[Side, Sequence[dict[str, Any]]]


def save_run(root: Path, name: str, from_run: str, chains: Chains) -> CommandJob:
    """Register a run with the model and domains of `from_run` and start computing it.

    A side that `chains` does not name keeps the adjustments of `from_run`. Raises RequestError for
    a name in use, an unknown run, a store that is read-only or being computed in, and cameras that
    cannot be moved; ModuleNotFoundError if the tools are not installed.
    """
    from s2rtools.precompute.run_registration import add_run, drop_run

    with locks.compute_lock(root):
        pass  # raises before anything is registered
    with s2rstore.open(root) as store:
        run = store.run(from_run)
        model = run.network("a run with adjusted images")
        sim, real = ([*chains.get(side, run.adjustments(side))] for side in SIDES)
        add_run(root, name, model, run.sim_domain, run.real_domain, {"sim": sim, "real": real})
        adjusted = replace(run, sim_adjustments=sim, real_adjustments=real)
        moves_camera = any(run_render_change(store, adjusted, side) != UNCHANGED for side in SIDES)
    try:
        return precompute_job(root, name, _STAGES + moves_camera)
    except OSError:
        with contextlib.suppress(StoreBusyError):
            drop_run(root, name)
        raise


def precompute_job(root: Path, run: str, stages: int) -> CommandJob:
    """Start the computation of one run, which is removed from the store if it fails.

    A run that is cancelled stays registered: `s2r precompute` continues it.
    """
    arguments = ["precompute", str(root.absolute()), "--run", run]
    return CommandJob(f"run {run}", arguments, stages, undo=partial(_drop, root, run))


def _drop(root: Path, run: str) -> None:
    """Remove a run, unless another process computes in the store, which may compute this run."""
    from s2rtools.precompute.run_registration import drop_run

    try:
        drop_run(root, run)
    except StoreBusyError:
        reason = f"run {run} stays, because another process computes in this store"
        raise RequestError(reason) from None

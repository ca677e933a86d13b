"""A small network trained on the residuals of the identified simulator, accepted if it helps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from s2rtools.sysid.heldout_error import HeldOut, compared
from s2rtools.sysid.identify import Identification
from s2rtools.sysid.simulators.simulator import Floats

if TYPE_CHECKING:
    from s2rtools.common.command_line.progress import Reporter

MIN_HELD_OUT = 2
"""Fewest held-out drives on which a network can be accepted."""


@dataclass(frozen=True, slots=True)
class Residual:
    """A trained network: `weights` are the bytes of a safetensors file, `error` compares the
    simulator without and with the network on held-out windows."""

    error: HeldOut
    weights: bytes

    @property
    def accepted(self) -> bool:
        """Whether the network improves the prediction, on enough held-out drives."""
        return self.error.helps and self.error.drives >= MIN_HELD_OUT

    @property
    def sentence(self) -> str:
        """The verdict and the errors, for the reader of a report."""
        error = self.error
        verdict = "helps" if self.accepted else "does not help and is discarded"
        if error.drives < MIN_HELD_OUT:
            verdict = f"discarded, because judging it needs {MIN_HELD_OUT} held-out drives"
        bounds = error.ratio.bounds_text(to=" .. ")
        turn = 57.29578 * error.untuned[1], 57.29578 * error.fitted[1]
        without, with_it = 100 * error.untuned[0], 100 * error.fitted[0]
        return (
            f"residual network: {verdict}; error on held-out windows {without:.2f} cm without and "
            f"{with_it:.2f} cm with it, ratio {error.ratio.value:.2f} ({bounds}); headings "
            f"{turn[0]:.2f} and {turn[1]:.2f} degrees"
        )

    def record(self) -> dict[str, Any]:
        """JSON data with six significant digits."""
        names = {"untuned": "without", "fitted": "with"}
        error = {names.get(key, key): value for key, value in self.error.record().items()}
        del error["helps"]
        return {"accepted": self.accepted, "sentence": self.sentence, **error}


def learn(result: Identification, reporter: Reporter, epochs: int = 200) -> Residual:
    """Train on fitted drives, with a quarter of them for early stopping; judge on held-out drives.

    Raises InconclusiveError where the logs are too coarse for steps of `STEP`.
    """
    from s2rtools.sysid.residual_network import CorrectionNetwork, stretches_of, train

    stretches = stretches_of(result.everything, result.cube)
    fitted = len(result.fitted)
    trained = fitted - max(1, fitted // 4)
    training = stretches.of(stretches.drive < trained)
    stopping = stretches.of((stretches.drive >= trained) & (stretches.drive < fitted))
    held_out = stretches.of(stretches.drive >= fitted)
    correction = CorrectionNetwork(training, result.settings.seed)
    train(correction, training, stopping, epochs, reporter)
    error = compared(_errors(held_out.states[:, :, :3], held_out.poses),
                     _errors(correction.poses(held_out), held_out.poses),
                     held_out.drive)  # fmt: skip
    return Residual(error, correction.saved(result.values))


def _errors(poses: Floats, real: Floats) -> Floats:
    """Root mean square position and heading errors (w, 2)."""
    x, y, heading = np.moveaxis(poses[:, 1:] - real[:, 1:], -1, 0)
    return np.sqrt(np.stack([(x**2 + y**2).mean(axis=1), (heading**2).mean(axis=1)], axis=1))

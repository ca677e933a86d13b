"""Figures of a drive as a whole, beside those of its windows."""

from __future__ import annotations

from dataclasses import dataclass

from s2rstore.errors import RequestError
from s2rtools.gap.dynamics import errors
from s2rtools.gap.dynamics.errors import Alignment, Step
from s2rtools.logs.contract import Drive, Log


@dataclass(frozen=True, slots=True)
class Whole:
    """`alignment` is taken out before APE and RPE, which compares poses a `step` apart."""

    alignment: Alignment = errors.NONE
    step: Step = errors.DEFAULT_STEP

    def figures(self, drive: Drive, sim: Log) -> dict[str, float | None]:
        """Root mean squares, m and rad; of `sim`, the drive's without its delay, and as recorded.

        RPE is None where no two poses are a step apart.
        """
        found = errors.ape(drive.real, sim, self.alignment)
        recorded = errors.ape(drive.real, drive.sim, self.alignment)
        return {
            "ape_rmse": errors.rmse(found.position),
            "ape_rmse_recorded": errors.rmse(recorded.position),
            "heading_rmse": errors.rmse(found.heading),
            **self._relative(drive.real, sim),
        }

    def _relative(self, real: Log, sim: Log) -> dict[str, float | None]:
        try:
            found = errors.rpe(real, sim, self.step, self.alignment)
        except RequestError:
            return {"rpe_rmse": None, "rpe_heading_rmse": None}
        return {
            "rpe_rmse": errors.rmse(found.position),
            "rpe_heading_rmse": errors.rmse(found.heading),
        }


WHOLE = Whole()

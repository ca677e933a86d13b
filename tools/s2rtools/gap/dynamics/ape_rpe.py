"""Figures of a drive as a whole, beside those of its windows."""

from __future__ import annotations

from dataclasses import dataclass

from s2rstore.errors import RequestError
from s2rtools.gap.dynamics import pose_errors
from s2rtools.gap.dynamics.pose_errors import LogAlignment, Step
from s2rtools.motion_logs.motion_log import Drive, Log


@dataclass(frozen=True, slots=True)
class Whole:
    """`alignment` is taken out before APE and RPE, which compares poses a `step` apart."""

    alignment: LogAlignment = pose_errors.NONE
    step: Step = pose_errors.DEFAULT_STEP

    def figures(self, drive: Drive, sim: Log) -> dict[str, float | None]:
        """Root mean squares, m and rad; of `sim`, the drive's without its delay, and as recorded.

        RPE is None where no two poses are a step apart.
        """
        found = pose_errors.ape(drive.real, sim, self.alignment)
        recorded = pose_errors.ape(drive.real, drive.sim, self.alignment)
        return {
            "ape_rmse": pose_errors.rmse(found.position),
            "ape_rmse_recorded": pose_errors.rmse(recorded.position),
            "heading_rmse": pose_errors.rmse(found.heading),
            **self._relative(drive.real, sim),
        }

    def _relative(self, real: Log, sim: Log) -> dict[str, float | None]:
        try:
            found = pose_errors.rpe(real, sim, self.step, self.alignment)
        except RequestError:
            return {"rpe_rmse": None, "rpe_heading_rmse": None}
        return {
            "rpe_rmse": pose_errors.rmse(found.position),
            "rpe_heading_rmse": pose_errors.rmse(found.heading),
        }


WHOLE = Whole()

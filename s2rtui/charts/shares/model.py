"""The numbers of the shares view: mean shares of the gap of the selection and of all."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from s2rstore.errors import counted
from s2rstore.metrics.gap_shares import FactorShare, GapShares
from s2rtui.drawing.scale import Interval, non_empty

_MARGIN = 0.5
"""Space for bounds beside the means, as a share of the range of the means."""
CONTRIBUTION = "estimated by exchanging factors between the images of a pair"


@dataclass(frozen=True, slots=True)
class SharesInput:
    """Mean shares of the selection and of the base population; None where there are none."""

    selected: GapShares | None
    everything: GapShares | None


@dataclass(frozen=True, slots=True)
class ShareBar:
    """The bar of a factor: its share of the selection, and `overall` its mean of all, metres."""

    factor: str
    share: FactorShare
    overall: float

    @property
    def text(self) -> str:
        """The mean and its interval in metres: `+2.41 m (1.90 to 3.02)`."""
        mean = self.share.mean
        bounds = f" ({mean.bounds_text()})" if mean.is_known else ""
        return f"{mean.value:+.2f} m{bounds}"


@dataclass(frozen=True, slots=True)
class SharesModel:
    """A bar per factor on one scale in metres.

    The scale holds 0, all means, and the bounds that are not far beyond these.
    """

    bars: tuple[ShareBar, ...]
    scale: Interval
    n: int
    gap: float
    apart: int = 0

    @property
    def counted(self) -> str:
        """The mean gap and the instances it is of: `mean gap +3.32 m, n 50`."""
        apart = f"; {counted(self.apart, 'pair')} too far apart left out" if self.apart else ""
        few = " (too few)" if not all(bar.share.mean.is_known for bar in self.bars) else ""
        return f"mean gap {self.gap:+.2f} m, n {self.n}{few}{apart}"


def shares_model(data: SharesInput) -> SharesModel | None:
    """The bars of the selection; None where it has no shares."""
    if data.selected is None or data.everything is None:
        return None
    overall = {share.factor: share.mean.value for share in data.everything.shares}
    bars = tuple(
        ShareBar(share.factor, share, overall[share.factor]) for share in data.selected.shares
    )
    means = [0.0, *(value for bar in bars for value in (bar.overall, bar.share.mean.value))]
    margin = _MARGIN * (max(means) - min(means))
    bounds = [value for bar in bars for value in (bar.share.mean.low, bar.share.mean.high)]
    ends = np.clip([*means, *(v for v in bounds if math.isfinite(v))],
                   min(means) - margin, max(means) + margin)  # fmt: skip
    scale = non_empty(float(ends.min()), float(ends.max()))
    chosen = data.selected
    return SharesModel(bars, scale, chosen.n, chosen.gap, chosen.apart)

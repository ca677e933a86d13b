"""The population: which instances of a run are counted.

A *trained* instance is one whose image, on either side, the run's model was fitted or chosen on
(splits `train` and `validation`). All other instances are *new* to the run. Views, figures,
reports and queries hold the new instances only, unless trained ones are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rstore.errors import counted
from s2rstore.index.columns import BoolColumn, InstanceColumns, RunColumns
from s2rstore.records import SIDES, SPLITS, TRAINING_SPLITS

INCLUDE_HINT = "M includes them"
"""What brings trained instances back on the screen."""
SPLIT_SQL = "CASE {} END".format(
    " ".join(f"WHEN '{split}' IN (sim_split, real_split) THEN '{split}'" for split in SPLITS)
)
"""The split of a row of view `pair`: the first in `records.SPLITS` of those of both sides."""


@dataclass(frozen=True, slots=True)
class Population:
    """The instances that count: those of `trajectories` (None: all) that are new to the run.

    `with_trained` adds the trained instances.
    """

    trajectories: tuple[str, ...] | None = None
    with_trained: bool = False

    def mask(self, truth: InstanceColumns, *runs: RunColumns) -> BoolColumn:
        """(N,) the instances that every run predicted on both sides, and that count in all of them.

        Read-only: for one run it may be a loaded column.
        """
        chosen = self.in_view(truth, *runs)
        for run in filter(self.leaves_out_trained, runs):
            chosen = chosen & ~run.trained
        return chosen

    def leaves_out_trained(self, run: RunColumns) -> bool:
        """Whether a run has trained instances, which do not count."""
        return not self.with_trained and bool(run.trained.any())

    def in_view(self, truth: InstanceColumns, *runs: RunColumns) -> BoolColumn:
        """(N,) the same with the trained instances, whatever `with_trained` is."""
        valid = runs[0].valid
        for run in runs[1:]:
            valid = valid & run.valid
        return self._in_trajectories(truth, valid)

    def unpaired(self, truth: InstanceColumns, run: RunColumns) -> BoolColumn:
        """(N,) the instances in view without an image in a domain of the run, nor in `mask`."""
        return self._in_trajectories(truth, ~run.paired & ~run.valid)

    def attempted(self, truth: InstanceColumns, run: RunColumns) -> BoolColumn:
        """(N,) as `mask` of one run, with the instances that the run did not localise."""
        chosen = self._in_trajectories(truth, run.attempted)
        return chosen & ~run.trained if self.leaves_out_trained(run) else chosen

    def _in_trajectories(self, truth: InstanceColumns, chosen: BoolColumn) -> BoolColumn:
        if self.trajectories is None:
            return chosen
        known = truth.trajectory_names
        codes = [known.index(name) for name in self.trajectories if name in known]
        is_named = np.zeros(len(known) + 1, dtype=np.bool_)  # the last for code -1
        is_named[codes] = True
        return chosen & is_named[truth.trajectory]


NEW_INSTANCES = Population()
"""The instances of all trajectories that are new to the run."""


def new_to_run(alias: str) -> str:
    """The SQL condition that a row of view `pair`, named `alias`, is a new instance."""
    known = ", ".join(f"'{split}'" for split in TRAINING_SPLITS)
    sides = (f"coalesce({alias}.{side}_split NOT IN ({known}), true)" for side in SIDES)
    return " AND ".join(sides)


def count_text(
    selected: int, in_view: int, trained: int, with_trained: bool, lone: str = ""
) -> str:
    """`8 of 40 (32 trained on)`: the selected instances, those in view, and the trained of these.

    Where `with_trained`, the trained instances may be selected: `40 of 40 (32 trained on,
    included)`. Without trained instances, `82 of 542`. With `lone`, an `unpaired_text`, the others
    are pairs: `82 of 542 pairs, 1,000 sim only`.
    """
    text = f"{selected} of {in_view}{' pairs' if lone else ''}"
    if trained:
        text += f" ({trained} trained on{', included' if with_trained else ''})"
    return f"{text}, {lone}" if lone else text


def unpaired_text(chosen: BoolColumn, run: RunColumns) -> str:
    """`1,000 sim only, 20 real only`: the domains of the run that image the `chosen` instances.

    Empty where none is chosen.
    """
    if not chosen.any():
        return ""
    counts = {f"{side} only": np.count_nonzero(chosen & run.side(side).imaged) for side in SIDES}
    counts["without images of the run"] = np.count_nonzero(chosen) - sum(counts.values())
    return ", ".join(f"{count:,} {text}" for text, count in counts.items() if count)


def left_out_text(count: int, hint: str = INCLUDE_HINT) -> str:
    """`24 trained instances left out: M includes them`; `hint` says what includes them."""
    return f"{counted(count, 'trained instance')} left out: {hint}"

"""Translators of a store with the facts that judging them needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import Direction, Side
from s2rtools.translation import fit_split
from s2rtools.translation.translator_file import StoredTranslator, open_stored
from s2rtools.translator_evaluation.fit_into_store import stored_split


@dataclass(frozen=True, slots=True, eq=False)
class NamedTranslator:
    """A translator from images of domain `source` to the look of domain `target`.

    `fitted` are the iids whose images were used for its fit, `held_out` those that judge it.
    """

    name: str
    stored: StoredTranslator
    direction: Direction
    source: str
    target: str
    fitted: NDArray[np.int64]
    held_out: NDArray[np.int64]

    @property
    def side(self) -> Side:
        """The side whose images it translates."""
        return "sim" if self.direction == "sim2real" else "real"


def named_translator(store: Store, name: str) -> NamedTranslator:
    """A translator of a store. Raises RequestError if it is unknown, missing or damaged."""
    record, split = store.translator(name), stored_split(store, name)
    return NamedTranslator(
        name,
        open_stored(store.path, record.sha256),
        record.direction,
        record.source_domain,
        record.target_domain,
        np.flatnonzero(split == fit_split.FITTED),
        np.flatnonzero(split == fit_split.HELD_OUT),
    )

"""Which images of the threshold study are judged, which are fitted on and which are tuned on.

Per light (condition) of the real images:

- Where at least `MIN_UNLABELLED` images are unlabelled, translators are fitted on those, and all
  labelled images are judged. Both may come from the same recording
  (`Split.lights_fitted_on_judged_recordings`).
- Else, where there are two recordings (sequences) or more, translators are fitted on every second
  one, and the others are judged.
- Else all images are judged and translators are fitted on the same images, without their labels.

Labels for tuning never come from the half of a recording that is judged: a labelled image is drawn
from other recordings that are not judged, or from the other half of the same recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from examples.duckietown.conditions import CONDITIONS, LightField
from examples.duckietown.line_detector import COLOURS
from examples.duckietown.road_images import RoadImages
from examples.duckietown.road_renderer import IGNORE
from s2rstore.arrays.row_array import evenly_spaced
from s2rstore.errors import RequestError
from s2rtools.translation.image_set import Rgb

Rows = NDArray[np.int64]

MIN_UNLABELLED = 8
_MIN_LABELLED = 2
_SURFACE = (-0.1, 0.5)
_PAINT = (-0.1, 0.15)
"""Ranges of the logarithm of factors on the grey levels of asphalt and of lines."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Judged rows of one light, and labelled rows of that light that may be tuned on for them.

    `half` is 0 or 1 where the judged images of the light are two halves that swap roles, so that
    images of several lights can be drawn without any judged one.
    """

    judged: Rows
    tuned: Rows
    half: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Rows of the real images: `judged` (n,) ascending, `fitted` by light, and the parts of the
    judged rows."""

    images: RoadImages
    judged: Rows
    fitted: dict[str, Rows]
    parts: list[Part]

    @property
    def lights(self) -> list[str]:
        """Lights with judged images."""
        return sorted(set(self.images.conditions[self.judged].tolist()))

    def judged_in(self, light: str) -> Rows:
        return self.judged[self.images.conditions[self.judged] == light]

    def tuning_rows(self, part: Part) -> Rows:
        """Labelled rows of all lights that may be tuned on for a part."""
        half = [other for other in self.parts if other.half == part.half]
        return np.sort(np.concatenate([other.tuned for other in half]))

    def lights_fitted_on_judged_recordings(self) -> list[str]:
        """Lights whose translators are fitted on images of the recordings that are judged."""
        recordings = self.images.sequences
        return [
            light
            for light in self.lights
            if np.isin(recordings[self.fitted[light]], recordings[self.judged_in(light)]).any()
        ]

    def lights_fitted_on_judged_images(self) -> list[str]:
        """Lights whose translators are fitted on the very images that are judged."""
        return [
            light
            for light in self.lights
            if np.isin(self.fitted[light], self.judged_in(light)).any()
        ]

    def fit_rows(self, light: str, scope: str) -> Rows:
        """Rows for a fit: of this `light`, of `all` lights, or of all `others`."""
        if scope == "light":
            return self.fitted[light]
        kept = [rows for name, rows in self.fitted.items() if scope == "all" or name != light]
        return np.sort(np.concatenate(kept)) if kept else np.zeros(0, dtype=np.int64)


def split_images(images: RoadImages) -> Split:
    """Roles of the images of a folder. Raises RequestError where nothing can be judged."""
    judged: list[Rows] = []
    fitted: dict[str, Rows] = {}
    parts: list[Part] = []
    for light in sorted(set(images.conditions.tolist())):
        rows = np.flatnonzero(images.conditions == light)
        labelled, unlabelled = rows[images.labelled[rows]], rows[~images.labelled[rows]]
        recordings = sorted(set(images.sequences[labelled].tolist()))
        if len(unlabelled) >= MIN_UNLABELLED or not len(labelled):
            fitted[light] = unlabelled
            chosen, pool = labelled, np.zeros(0, dtype=np.int64)
        elif len(recordings) > 1:
            is_pool = np.isin(images.sequences[labelled], recordings[::2])
            chosen, pool = labelled[~is_pool], labelled[is_pool]
            fitted[light] = np.sort(np.concatenate([unlabelled, pool]))
        else:
            fitted[light] = rows
            chosen, pool = labelled, np.zeros(0, dtype=np.int64)
        if len(chosen) < _MIN_LABELLED:
            continue
        judged.append(chosen)
        if len(pool):
            parts.append(Part(chosen, pool))
        else:
            first, second = _halves(images, chosen)
            parts += [Part(first, second, 0), Part(second, first, 1)]
    if not judged:
        raise RequestError(
            f"{images.name}: no light with {_MIN_LABELLED} labelled images; label some, or name "
            "a folder with masks"
        )
    return Split(images, np.sort(np.concatenate(judged)), fitted, parts)


def _halves(images: RoadImages, rows: Rows) -> tuple[Rows, Rows]:
    """The first and second half of the recordings of some rows, or of their only recording."""
    recordings = sorted(set(images.sequences[rows].tolist()))
    if len(recordings) > 1:
        first = np.isin(images.sequences[rows], recordings[: len(recordings) // 2])
        return rows[first], rows[~first]
    return rows[: len(rows) // 2], rows[len(rows) // 2 :]


def simulated_lights(sim: RoadImages, seed: int, images_per_light: int = 32) -> RoadImages:
    """Labelled simulated images in every light of `CONDITIONS`, at the detector's resolution.

    As in reality, the images of a light come from few places: half of them, from one recording, are
    for fitting (unlabelled), half, from another recording, for judging. Colours are taken as
    albedo, and the surfaces of each light vary.
    """
    recordings = _recordings(sim)
    size = (sim.images.shape[1], sim.images.shape[2])
    pieces = []
    for number, (name, condition) in enumerate(CONDITIONS.items()):
        rng = np.random.default_rng([seed, number, 61])
        light = LightField(condition, size, seed * 100 + number)
        factors = np.exp([rng.uniform(*_SURFACE), rng.uniform(*_PAINT)])
        for part, place in enumerate(rng.choice(len(recordings), 2, replace=False)):
            piece = sim.rows(evenly_spaced(recordings[place], images_per_light // 2))
            lit = np.stack([light.apply(image) for image in _resurfaced(piece, *factors)])
            count = len(piece)
            pieces.append(
                RoadImages(
                    name, lit, piece.masks if part == 1 else np.full_like(piece.masks, IGNORE),
                    np.full(count, part == 1), np.full(count, name),
                    np.array([f"{name}-{sequence}" for sequence in piece.sequences]),
                    tuple(f"{name}/{file}" for file in piece.files), piece.poses,
                )
            )  # fmt: skip
    return _joined("simulated lights", pieces)


def _recordings(sim: RoadImages) -> list[Rows]:
    """Labelled rows of each recording; the halves of the only one where there is one."""
    labelled = np.flatnonzero(sim.labelled)
    names = sorted(set(sim.sequences[labelled].tolist()))
    if len(names) > 1:
        return [labelled[sim.sequences[labelled] == name] for name in names]
    if len(labelled) < 2 * _MIN_LABELLED:
        raise RequestError(f"{sim.name}: {len(labelled)} labelled images; render more")
    return [labelled[: len(labelled) // 2], labelled[len(labelled) // 2 :]]


def _resurfaced(images: RoadImages, surface: float, paint: float) -> Rgb:
    """Images with the grey levels of the ground and of the lines multiplied by factors.

    Real roads differ from simulated ones by more than the light; a translator that takes such a
    difference for light has to show it here.
    """
    lines = np.isin(images.masks, range(1, len(COLOURS) + 1))[..., None]
    scaled = np.clip(images.images * np.where(lines, paint, surface), 0, 255)
    return np.asarray(scaled.astype(np.uint8))


def _joined(name: str, parts: list[RoadImages]) -> RoadImages:
    return RoadImages(
        name,
        np.concatenate([part.images for part in parts]),
        np.concatenate([part.masks for part in parts]),
        np.concatenate([part.labelled for part in parts]),
        np.concatenate([part.conditions for part in parts]),
        np.concatenate([part.sequences for part in parts]),
        tuple(file for part in parts for file in part.files),
        np.concatenate([part.poses for part in parts]),
    )

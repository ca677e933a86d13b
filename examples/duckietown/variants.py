"""Variants of the threshold study: thresholds, translators in front of them, and their fits."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from examples.duckietown.line_detector import (
    DEFAULT_THRESHOLDS,
    Thresholds,
    anti_instagram,
)
from examples.duckietown.road_images import RoadImages
from s2rstore.arrays.row_array import evenly_spaced
from s2rstore.errors import RequestError
from s2rtools import translation
from s2rtools.common.result_files import write_all
from s2rtools.translation import METHODS
from s2rtools.translation.image_set import ImageSet, Rgb
from s2rtools.translation.method import FitSettings, Translator, lower_share
from s2rtools.translation.translator_file import (
    StoredTranslator,
    encode,
    read_translator,
)

Direction = Literal["none", "real2sim", "sim2real"]
Scope = Literal["image", "light", "all", "others", "file"]

FIT_SCOPES: tuple[Scope, ...] = ("light", "all", "others")
"""Real images of a fit: of the judged light, of all lights, of all other lights."""
THRESHOLD_KINDS = ("default", "default+ai", "sim")
"""Duckietown's ranges, the same after the anti-instagram map, and ranges tuned on simulation."""
BASELINE = "default+ai"
SUFFIX = ".safetensors"
_OF_IMAGE = ("grayworld", "fda")
"""Methods whose fit uses the target images alone."""
LOWER_HALF = ("mkl", "unit")
"""Methods that `all` also tries on the lower half of the images, which shows mostly road."""
_MAX_FRAMES = 400
"""Images of a domain that a translator is fitted on, at most."""
_BATCH = 32


@dataclass(frozen=True, slots=True)
class Source:
    """A translator of the study: a method with options, or a file."""

    text: str
    method: str
    options: tuple[tuple[str, str], ...] = ()
    file: Path | None = None
    lower: float = 1.0
    """Share of the rows, from the bottom, that is translated."""

    @property
    def learned(self) -> bool:
        return self.file is None and METHODS[self.method].learned

    @property
    def of_image(self) -> bool:
        """Whether the source's statistics are those of each image: the fit uses no real image."""
        return self.method in _OF_IMAGE or dict(self.options).get("statistics") == "image"


@dataclass(frozen=True, slots=True)
class Variant:
    """Thresholds, alone or with a translator of a direction; `scope` names the real images of its
    fit. A `guarded` variant is `BASELINE` in lights in which the detections of that are plausible.
    """

    thresholds: str
    source: Source | None = None
    direction: Direction = "none"
    scope: Scope = "image"
    guarded: bool = False

    @property
    def name(self) -> str:
        if self.guarded:
            return f"{BASELINE} | {replace(self, guarded=False).name}"
        if self.source is None:
            return self.thresholds
        if self.direction == "sim2real":
            return f"sim2real {self.source.text} ({self.scope})"
        return f"{self.source.text} ({self.scope}) > {self.thresholds}"


def parse_sources(texts: str | None) -> list[Source]:
    """Translators of a comma-separated list: METHOD, METHOD:OPTION=VALUE[:...] or FILE.

    `lower=SHARE` is an option of every method: the lowest share of the rows is translated alone.
    None is every method that needs no training, and its per-image form where it has one; `all` are
    the learned ones, too, and those of `LOWER_HALF` on the lower half. Raises RequestError for
    unknown methods and options and for damaged files.
    """
    if texts is None or texts == "all":
        sources = []
        for method in METHODS.values():
            if method.learned and texts is None:
                continue
            if method.name != "identity":
                sources.append(Source(method.name, method.name))
            if "statistics" in method.options:
                option = ("statistics", "image")
                sources.append(Source(f"{method.name}:image", method.name, (option,)))
        if texts == "all":
            sources += [_parse_source(f"{name}:lower=0.5") for name in LOWER_HALF]
        return sources
    return [_parse_source(text.strip()) for text in texts.split(",") if text.strip()]


def _parse_source(text: str) -> Source:
    if text.endswith(SUFFIX):
        stored = read_translator(Path(text))
        return Source(Path(text).stem, stored.method, file=Path(text))
    name, *settings = text.split(":")
    method = METHODS.find(name)
    options, lower = [], 1.0
    for setting in settings:
        key, _, value = ("statistics=image" if setting == "image" else setting).partition("=")
        if key == "lower":
            lower = lower_share(value, f"translator {text!r}")
            continue
        if key not in method.options or not value:
            known = ", ".join(method.options) or "it has none"
            raise RequestError(f"translator {text!r}: option {key!r} of {name}: {known}")
        options.append((key, value))
    return Source(text, name, tuple(options), lower=lower)


def parse_scopes(text: str | None) -> tuple[Scope, ...]:
    """Scopes of a comma-separated list, all by default. Raises RequestError for unknown ones."""
    names = list(FIT_SCOPES) if text is None else [name.strip() for name in text.split(",")]
    for name in names:
        if name not in FIT_SCOPES:
            raise RequestError(f"scope {name!r}: one of {', '.join(FIT_SCOPES)}")
    return tuple(scope for scope in FIT_SCOPES if scope in names)


def variants_of(
    sources: list[Source], lights: int, fit_scopes: tuple[Scope, ...] = FIT_SCOPES
) -> list[Variant]:
    """Variants without labels of real images: every threshold alone, then each translator, fitted
    on the images of each of `fit_scopes`; with a single light, on those of that light."""
    variants = [Variant(kind) for kind in THRESHOLD_KINDS]
    variants.append(Variant("sim+ai"))
    for source in sources:
        if source.file is not None:
            scopes: tuple[Scope, ...] = ("file",)
        elif source.of_image:
            scopes = ("image",)
        else:
            scopes = fit_scopes if lights > 1 else ("light",)
        for scope in scopes:
            variants += [Variant(kind, source, "real2sim", scope) for kind in THRESHOLD_KINDS]
        if not source.of_image and source.file is None:
            variants += [Variant("sim", source, "sim2real", scope) for scope in scopes]
    return variants


@dataclass(frozen=True, slots=True)
class FitRequest:
    """What determines a fitted translator of the study."""

    source: Source
    direction: Direction
    seed: int
    minutes: float | None


class TranslatorCache:
    """Fits translators, and keeps them as files in a folder so that a later call finds them."""

    def __init__(self, folder: Path | None, say: Callable[[str], None] = lambda line: None) -> None:
        self.folder, self.say = folder, say
        self._fitted: dict[str, Translator] = {}

    def get(self, request: FitRequest, source: ImageSet, target: ImageSet) -> Translator:
        """The translator of a request, fitted where no file of it exists.

        Raises RequestError where a method cannot be fitted on the images.
        """
        if request.source.file is not None:
            return read_translator(request.source.file).translator
        key = _key(request, source, target)
        if key not in self._fitted:
            self._fitted[key] = self._restored(key) or self._fit(key, request, source, target)
        return self._fitted[key]

    def _restored(self, key: str) -> Translator | None:
        if self.folder is None or not (path := self.folder / f"{key}{SUFFIX}").exists():
            return None
        return read_translator(path).translator

    def _fit(self, key: str, request: FitRequest, source: ImageSet, target: ImageSet) -> Translator:
        method = METHODS[request.source.method]
        checkpoint = None
        if self.folder is not None:
            self.folder.mkdir(parents=True, exist_ok=True)
            checkpoint = self.folder / f"{key}.checkpoint" if method.learned else None
        if method.learned:
            self.say(
                f"fitting {method.name}, {request.direction}, seed {request.seed}: "
                f"{len(source)} and {len(target)} images"
            )
        settings = FitSettings(
            seed=request.seed, minutes=request.minutes if method.learned else None,
            options=dict(request.source.options), checkpoint=checkpoint,
            lower=request.source.lower,
        )  # fmt: skip
        translator = method.fit(_limited(source), _limited(target), settings).translator
        if self.folder is not None:
            stored = StoredTranslator(translator, source.name, target.name, source.size)
            write_all({self.folder / f"{key}{SUFFIX}": encode(stored)})
            if checkpoint is not None:
                checkpoint.unlink(missing_ok=True)
        return translator


def _limited(images: ImageSet) -> ImageSet:
    return images.rows(evenly_spaced(np.arange(len(images)), _MAX_FRAMES))


def _key(request: FitRequest, source: ImageSet, target: ImageSet) -> str:
    method = METHODS[request.source.method]
    seed, minutes = (request.seed, request.minutes) if method.learned else (0, None)
    options = [(name, value, _file_digest(value)) for name, value in request.source.options]
    facts = [
        method.name, _translation_code(), options, request.source.lower, request.direction, seed,
        minutes,
    ]  # fmt: skip
    digest = hashlib.sha256(json.dumps(facts).encode())
    for images in (source, target):
        digest.update(json.dumps(images.images.shape).encode())
        digest.update(np.ascontiguousarray(images.images).tobytes())
        digest.update(np.ascontiguousarray(images.groups, dtype=np.int64).tobytes())
    return f"{method.name}-{digest.hexdigest()[:16]}"


@cache
def _translation_code() -> str:
    """Hash of the code of all methods: the default values of their options are part of it."""
    digest = hashlib.sha256()
    for path in sorted(Path(translation.__file__).parent.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _file_digest(value: str) -> str | None:
    """Hash of the file that the value of an option names; None for other values."""
    path = Path(value)
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None


def translated(translator: Translator | None, images: Rgb) -> Rgb:
    """Images (N, H, W, 3) through a translator, in batches."""
    if translator is None or not len(images):
        return images
    parts = range(0, len(images), _BATCH)
    return np.concatenate([translator.translate(images[start : start + _BATCH]) for start in parts])


def prepared(kind: str, images: Rgb) -> Rgb:
    """Images as thresholds of a kind expect them."""
    return anti_instagram(images) if kind.endswith("+ai") else images


def thresholds_of(kind: str, tuned: Mapping[str, Thresholds]) -> Thresholds:
    """Ranges of a kind: Duckietown's, or those in `tuned`."""
    return DEFAULT_THRESHOLDS if kind.startswith("default") else tuned[kind]


def fit_sets(
    variant: Variant, real: RoadImages, sim: RoadImages
) -> tuple[ImageSet, ImageSet]:  # fmt: skip
    """The source images and the target images on which the translator of a variant is fitted."""
    sets = real.image_set(), sim.image_set()
    return sets if variant.direction == "real2sim" else (sets[1], sets[0])

"""Fit a translator on the frames of a store, check its content and register it."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.arrays.row_array import evenly_spaced
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import check_writable, edit
from s2rstore.reader import Store
from s2rstore.records import DIRECTIONS, SIDES, Direction
from s2rtools.models.model_registration import check_name_free
from s2rtools.precompute.prediction_rows import decode_split, encode_split
from s2rtools.precompute.run_registration import find_domain
from s2rtools.translation import METHODS, fit_split
from s2rtools.translation.depth_noise import DepthNoise, measure
from s2rtools.translation.image_set import (
    ImageSet,
    fit_size,
    from_folder,
    from_store,
)
from s2rtools.translation.method import (
    FitResult,
    FitSettings,
    TranslationMethod,
    Translator,
)
from s2rtools.translation.translator_file import (
    StoredTranslator,
    encode,
    names_digest,
    stored_path,
)
from s2rtools.translator_evaluation.measures import Verdict, judge, measure_content

MAX_FITTED = 2000
"""Most images of a domain that a translator is fitted on; of more, evenly spaced ones."""
_NOISE_FRAMES = 64
_CHECKED_IMAGES, _MIN_CHECKED = 64, 8


@dataclass(frozen=True, slots=True)
class FitRequest:
    """A translator to fit; `domains` are the names of the sim and the real domain."""

    method: str
    name: str
    direction: Direction = "sim2real"
    domains: tuple[str, str] | None = None
    depth_noise: bool = False
    long_edge: int = 160
    settings: FitSettings = field(default_factory=FitSettings)


def fit_into_store(root: Path, request: FitRequest, command: str) -> Verdict | None:
    """Fit, check the content of held-out images, and publish the translator.

    Returns the verdict, None where too few images are held out. An interrupted fit continues from
    its checkpoint when the same request is repeated. Raises RequestError for unknown names and
    names that exist already.
    """
    name = layout.checked_name(request.name, "translator")
    method = METHODS.find(request.method)
    if request.direction not in DIRECTIONS:
        raise RequestError(f"--direction {request.direction}: one of {', '.join(DIRECTIONS)}")
    _check_uses_pairs(method, request.settings)
    check_writable(root)
    with s2rstore.open(root) as store:
        if name in store.translators:
            raise RequestError(f"--name {name}: already in {root}; choose another")
        source, target = named_domains(store, request.direction, request.domains)
        if request.depth_noise:
            store.require_poses("--depth-noise")
        if request.settings.paired:
            store.require_poses("--paired")
        checkpoint = _checkpoint(store, request)
        size = fit_size(store.dataset.frame_height, store.dataset.frame_width, request.long_edge)
        codes = _split_codes(store, source, target)
        iids = np.flatnonzero(codes == fit_split.FITTED)
        pairs = iids[store.imaged(source, target)[iids]]
        if request.settings.paired:
            iids = pairs
        settings = replace(request.settings, checkpoint=checkpoint)
        fitted = method.fit(
            from_store(store, source, iids, size), from_store(store, target, iids, size), settings
        )
        held_out = [_checked_images(store, name, codes, size) for name in (source, target)]
        verdict = _check_content(fitted.translator, *held_out)
        noise = _measure_depth_noise(store, source, target, pairs) if request.depth_noise else None
    stored = StoredTranslator(fitted.translator, source, target, size, noise)
    publish(root, name, stored, request, fitted, codes, verdict, command)
    checkpoint.unlink(missing_ok=True)
    return verdict


def _check_uses_pairs(method: TranslationMethod, settings: FitSettings) -> None:
    if settings.paired and not method.uses_pairs:
        able = ", ".join(name for name, each in METHODS.items() if each.uses_pairs)
        raise RequestError(f"--paired: {method.name} does not use pairs; methods that do: {able}")


def _checked_images(
    store: Store, domain: str, codes: NDArray[np.int8], size: tuple[int, int]
) -> ImageSet | None:
    """Held-out images of a domain at the size of the fit; None where too few are held out."""
    iids = np.flatnonzero(store.imaged(domain) & (codes == fit_split.HELD_OUT))
    if len(iids) < _MIN_CHECKED:
        return None
    return from_store(store, domain, evenly_spaced(iids, _CHECKED_IMAGES), size)


def _check_content(
    translator: Translator, before: ImageSet | None, target_images: ImageSet | None
) -> Verdict | None:
    """Judge the content of held-out images; None where there are too few."""
    if before is None or target_images is None:
        return None
    return judge(
        measure_content(before.images, translator.translate(before.images), target_images.images)
    )


def _split_codes(store: Store, source: str, target: str) -> NDArray[np.int8]:
    """Codes (N,) of `fit_split`, with at most `MAX_FITTED` images of each domain for the fit."""
    codes = fit_split.split_codes(store.instances.trajectory)
    used = np.zeros(len(codes), dtype=np.bool_)
    for domain in (source, target):
        iids = np.flatnonzero(store.imaged(domain) & (codes == fit_split.FITTED))
        used[evenly_spaced(iids, MAX_FITTED)] = True
    codes[(codes == fit_split.FITTED) & ~used] = fit_split.UNSEEN
    return codes


def stored_split(store: Store, name: str) -> NDArray[np.int8]:
    """Codes (N,) of `fit_split` with which a translator was fitted.

    Raises RequestError for a translator without them.
    """
    encoded = store.provenance(f"translator:{name}").get("split")
    if encoded is None:
        raise RequestError(
            f"translator {name}: {store.path} does not record which images it was fitted on; fit "
            "it again"
        )
    return decode_split(encoded, len(store.instances))


def publish(
    root: Path,
    name: str,
    stored: StoredTranslator,
    request: FitRequest,
    fitted: FitResult,
    codes: NDArray[np.int8],
    verdict: Verdict | None,
    command: str,
) -> None:
    """Write the translator's file and list it in the next generation."""
    content = encode(stored)
    sha256 = hashlib.sha256(content).hexdigest()
    file = stored_path(sha256)
    with edit(root) as draft:
        check_name_free(draft, "translator", name)
        atomic_writes.make_folder(root, layout.TRANSLATORS)
        atomic_writes.write(root, file, content)
        Ledger(root).add(f"translator:{sha256}", [(file, 1)])
        draft.record_checksums({file: sha256})
        draft.insert_row(
            "translator",
            {
                "translator": name,
                "method": stored.method,
                "direction": request.direction,
                "source_domain": stored.source,
                "target_domain": stored.target,
                "sha256": sha256,
                "accepted": None if verdict is None else verdict.passed,
                "reasons": [] if verdict is None else list(verdict.reasons),
                "created_at": datetime.now(UTC).isoformat(timespec="microseconds"),
            },
        )
        facts: dict[str, Any] = {
            "seed": request.settings.seed,
            "paired": request.settings.paired,
            "options": json.dumps(dict(request.settings.options), sort_keys=True),
            "lower": request.settings.lower,
            "size": list(stored.size),
            "split": encode_split(codes),
            "split_rule": fit_split.RULE,
            "history": json.dumps(fitted.history),
            "command": command,
            **fitted.facts,
        }
        draft.set_provenance(f"translator:{name}", facts)


def fit_folders(source: Path, target: Path, request: FitRequest, out: Path) -> Verdict | None:
    """Fit on two folders of images, check the content of held-out images and write the file.

    Images are held out as in a store; each subfolder counts as one recording. Returns the verdict,
    None where too few images are held out. Raises RequestError, also for `paired` folders whose
    file names differ.
    """
    if out.exists():
        raise RequestError(f"{out}: exists already; choose another name")
    method = METHODS.find(request.method)
    _check_uses_pairs(method, request.settings)
    images = from_folder(source, long_edge=request.long_edge)
    target_images = from_folder(target, images.size)
    if request.settings.paired and images.names != target_images.names:
        name = min(set(images.names) ^ set(target_images.names))
        raise RequestError(f"--paired: {name} is not in both {source} and {target}")
    checkpoint = out.with_name(f".{out.name}.checkpoint") if method.learned else None
    fitted = method.fit(
        _rows_of_fit(images, fit_split.FITTED, MAX_FITTED),
        _rows_of_fit(target_images, fit_split.FITTED, MAX_FITTED),
        replace(request.settings, checkpoint=checkpoint),
    )
    held_out = [
        _rows_of_fit(each, fit_split.HELD_OUT, _CHECKED_IMAGES) for each in (images, target_images)
    ]
    enough = all(len(each) >= _MIN_CHECKED for each in held_out)
    verdict = _check_content(fitted.translator, *held_out) if enough else None
    folders = names_digest(images), names_digest(target_images)
    stored = StoredTranslator(
        fitted.translator, source.name, target.name, images.size, folders=folders
    )
    out.parent.mkdir(parents=True, exist_ok=True)
    atomic_writes.write_file(out, encode(stored))
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    return verdict


def _rows_of_fit(images: ImageSet, code: int, most: int) -> ImageSet:
    """At most `most` of the images with a code of `fit_split`, evenly spaced."""
    rows = np.flatnonzero(fit_split.split_codes(images.groups) == code)
    return images.rows(evenly_spaced(rows, most))


def named_domains(
    store: Store, direction: Direction, domains: tuple[str, str] | None
) -> tuple[str, str]:
    """Source and target domain of a direction; by default the first sim and real domain.

    Raises RequestError for `domains` that are not a sim and a real one.
    """
    sim, real = domains or (find_domain(store, side, None) for side in SIDES)
    if sim == real:
        raise RequestError(f"--domains {sim},{real}: name two different domains")
    for side, name in zip(SIDES, (sim, real), strict=True):
        if (kind := store.domain(name).kind) != side:
            raise RequestError(
                f"--domains {sim},{real}: {name} is a {kind} domain; name them as SIM,REAL"
            )
    return (sim, real) if direction == "sim2real" else (real, sim)


def _checkpoint(store: Store, request: FitRequest) -> Path:
    """Path of this request's checkpoint in the user's cache folder."""
    settings = request.settings
    facts = [
        store.dataset.hash, request.method, request.name, request.direction, request.domains,
        request.long_edge, settings.seed, settings.steps, settings.minutes, settings.paired,
        settings.lower, sorted(settings.options.items()),
    ]  # fmt: skip
    digest = hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "s2rtui" / "translation"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"{request.method}-{digest}.safetensors"


def _measure_depth_noise(
    store: Store, source: str, target: str, iids: NDArray[np.intp]
) -> DepthNoise:
    chosen = evenly_spaced(iids, _NOISE_FRAMES)
    images = []
    for name in (source, target):
        domain = store.domain(name)
        raw = np.stack([store.frames(name, iid, iid + 1, ("depth",))["depth"][0] for iid in chosen])
        valid = (raw >= domain.depth_raw_min) & (raw <= domain.depth_raw_max)
        images.append(((raw * domain.depth_scale).astype(np.float32), valid))
    camera = store.domain(source)
    hole = max(0, camera.depth_raw_min - 1)
    return measure(images[0], images[1], camera.depth_scale, hole)

"""Train on a store's frames and register the model with a run."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files.layout import checked_name
from s2rstore.index.transaction import check_writable, edit
from s2rstore.language import evaluation
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, Domain
from s2rtools.adjustments.adjustment import Images
from s2rtools.models import build_network
from s2rtools.models.input_contract import InputContract
from s2rtools.models.load_model import load_model
from s2rtools.models.model_registration import check_name_free, pack_weights, register_model
from s2rtools.models.pose_network import LoadedModel
from s2rtools.precompute.frame_reader import adjusted_images
from s2rtools.precompute.prediction_rows import decode_split, encode_split
from s2rtools.precompute.run_registration import checked_translators, find_domain, insert_run
from s2rtools.training.evaluation import Splits
from s2rtools.training.recipes import TrainingRecipe, find_recipe
from s2rtools.training.training_frames import (
    CopiedFrames,
    DomainFrames,
    StreamedFrames,
    TrainingFrames,
)
from s2rtools.training.training_loop import Budget, ReportProgress, TrainingResult, train

_BLOCK = 64


@dataclass(frozen=True, slots=True)
class TrainingRequest:
    """`start` names the run whose model is trained further; `name` defaults to the recipe's.

    `translator` changes the sim images; `force` allows one that failed a check of its content.
    `expression` selects the instances to learn from, by default all.
    """

    recipe: str
    name: str | None = None
    start: str | None = None
    architecture: str = "resposenet"
    minutes: float = 2.0
    steps: int | None = None
    seed: int = 0
    translator: str | None = None
    force: bool = False
    expression: str | None = None


def train_into_store(
    root: Path, request: TrainingRequest, report: ReportProgress, command: str
) -> str:
    """Train, publish the model and a run of it; return the run's name.

    An interrupted training continues from its checkpoint when the same request is repeated. Raises
    RequestError for unknown names and names that exist already.
    """
    with s2rstore.open(root) as store:
        plan = _plan(store, root, request)
        start, start_splits, contract = plan.start, plan.start_splits, plan.contract
        domains, chain = plan.domains, plan.chain
        checkpoint = _checkpoint(store, request, start, contract, chain)
        frames = _frames(store, plan.recipe, domains, contract, chain, checkpoint.parent)
        result = train(
            frames,
            request.recipe,
            architecture=request.architecture,
            budget=Budget(request.minutes, request.steps),
            seed=request.seed,
            start=start,
            start_splits=start_splits,
            report=report,
            checkpoint=checkpoint,
            adjustments=chain,
            selected=plan.selected,
        )
    splits = {**(start_splits or {}), **result.splits}
    _publish(root, plan.name, result, contract, splits, domains, chain, command)
    checkpoint.unlink(missing_ok=True)
    return plan.name


def check_request(root: Path, request: TrainingRequest) -> None:
    """Raise RequestError where `train_into_store` would, without training anything."""
    with s2rstore.open(root) as store:
        _plan(store, root, request)


@dataclass(frozen=True, slots=True)
class _Plan:
    """What a request means in a store.

    `start_splits` are the splits of `start` by domain, `selected` (N,) the instances to learn from.
    """

    name: str
    recipe: TrainingRecipe
    start: LoadedModel | None
    start_splits: dict[str, Any] | None
    contract: InputContract
    domains: tuple[str, str]
    chain: list[dict[str, Any]]
    selected: NDArray[np.bool_] | None


def _plan(store: Store, root: Path, request: TrainingRequest) -> _Plan:
    """Check a request. Raises RequestError for unknown names and names that exist already."""
    name = checked_name(request.name or request.recipe, "run")
    recipe = find_recipe(request.recipe)
    check_writable(root)
    store.require_poses("training")
    if name in store.runs or name in store.models:
        raise RequestError(f"--name {name}: already in {root}; choose another")
    if recipe.needs_start and request.start is None:
        raise RequestError(f"--recipe {recipe.name}: name the run to begin with by --from RUN")
    start, start_splits = None, None
    if request.start is not None:
        model = store.run(request.start).network("training that begins with it")
        start = load_model(store, model)
        facts, n = store.provenance(f"model:{start.name}"), len(store.instances)
        start_splits = {d: decode_split(facts.get(f"split:{d}"), n) for d in store.domains}
    contract = start.contract if start else build_network(request.architecture).contract
    _check_trainable(contract, start)
    domains = find_domain(store, "sim", None), find_domain(store, "real", None)
    if contract.has_depth:
        store.require_depth(domains, f"architecture {request.architecture}")
    chain = _translation(store, recipe, request, domains[0])
    selected = _selected(store, request)
    return _Plan(name, recipe, start, start_splits, contract, domains, chain, selected)


def _selected(store: Store, request: TrainingRequest) -> NDArray[np.bool_] | None:
    """(N,) the instances to learn from; None for all."""
    if request.expression is None:
        return None
    names = [request.start] if request.start else list(store.runs)
    run = next((name for name in names if store.run(name).key), NO_RUN)
    asked = evaluation.query(store, request.expression, run, with_trained=True)
    evaluation.require_predictions(store, asked)
    if not asked.instances.any():
        raise RequestError(f"--select {request.expression}: selects no instance")
    return asked.instances


def _translation(
    store: Store, recipe: TrainingRecipe, request: TrainingRequest, domain: str
) -> list[dict[str, Any]]:
    """The chain that translates the sim images of a recipe; empty for the other recipes."""
    if not recipe.needs_translator:
        if request.translator is not None:
            raise RequestError(f"--translator: not with --recipe {recipe.name}")
        return []
    if request.translator is None:
        known = ", ".join(store.translators) or "none: `s2r translate fit` makes one"
        raise RequestError(f"--recipe {recipe.name}: name a --translator (in the store: {known})")
    step = {"name": f"translate:{request.translator}", "value": 1.0}
    return checked_translators(store, "sim", domain, [step], request.force)


def _frames(
    store: Store,
    recipe: TrainingRecipe,
    domains: tuple[str, str],
    contract: InputContract,
    chain: list[dict[str, Any]],
    folder: Path,
) -> TrainingFrames:
    """The frames of the domains that a training needs.

    Those that the recipe learns from are copied to temporary files in `folder`, because they are
    read in random order and repeatedly. Those of the run that it does not learn from are read once
    from the store, for the metrics. With a `chain` of adjustments for the sim domain of the run,
    the other sim domains are left out.
    """
    truth = store.instances
    frames: dict[str, DomainFrames] = {}
    for name, domain in store.domains.items():
        if chain and domain.kind == "sim" and name != domains[0]:
            continue
        read = partial(_adjusted_frames, store, domain, chain if name == domains[0] else [])
        if domain.kind in recipe.learns_from:
            starts = range(0, len(truth), _BLOCK)
            blocks = (
                block for start in starts for block in read(start, min(start + _BLOCK, len(truth)))
            )
            frames[name] = CopiedFrames.from_blocks(
                domain.kind, blocks, len(truth), contract, domain.depth_scale, folder
            )
        elif name in domains:
            frames[name] = StreamedFrames(domain.kind, read, contract, domain.depth_scale)
    poses = np.stack([truth.x, truth.y, truth.heading], axis=1)
    own = {name: store.poses(name) for name in frames if store.has_own_poses(name)}
    imaged = {name: store.imaged(name) for name in frames}
    partly = {name: mask for name, mask in imaged.items() if not mask.all()}
    return TrainingFrames(frames, poses, truth.trajectory, own, partly)


def _adjusted_frames(
    store: Store, domain: Domain, chain: list[dict[str, Any]], start: int, stop: int
) -> Iterator[Images]:
    """Images of iids [start, stop) at the size of their source, in blocks of one size.

    Instances without an image in the domain have black ones of the frame size.
    """
    imaged = store.imaged(domain.domain)
    edges = start + 1 + np.flatnonzero(np.diff(imaged[start:stop]))
    for first, last in pairwise([start, *edges.tolist(), stop]):
        if not imaged[first]:
            known = int(imaged.argmax())
            black = store.frames(domain.domain, known, known + 1)
            rgb, depth = (np.repeat(0 * black[name], last - first, axis=0) for name in black)
            yield rgb, depth
            continue
        for _, images in store.source_frames(domain.domain, first, last):
            rgb, depth, _ = adjusted_images(
                images, domain, chain, store.path, store.dataset.frame_width
            )
            yield rgb, depth


def _check_trainable(contract: InputContract, start: LoadedModel | None) -> None:
    """Raise RequestError for a model whose input augmentations and losses do not suit."""
    usual = InputContract(
        size=contract.size,
        rgb_interpolation=contract.rgb_interpolation,
        depth_interpolation=contract.depth_interpolation,
    )
    if contract != usual and start is not None:
        raise RequestError(
            f"--from: model {start.name} takes another input ({contract.channels}, scaled its own "
            "way) than RGB and depth in [-1, 1], which training gives; train it elsewhere and add "
            "it by `s2r model add`"
        )


def _checkpoint(
    store: Store,
    request: TrainingRequest,
    start: LoadedModel | None,
    contract: InputContract,
    chain: list[dict[str, Any]],
) -> Path:
    """Path of this request's checkpoint in the user's cache folder.

    `chain` holds the hash of the translator: another store may have another one of the same name.
    """
    facts = [store.dataset.hash, repr(request), start.sha256 if start else None, chain]
    facts.append(contract.to_json())
    digest = hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:16]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = cache / "s2rtui" / "training"
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"{request.recipe}-{digest}.safetensors"


def _publish(
    root: Path,
    name: str,
    result: TrainingResult,
    contract: InputContract,
    codes_by_domain: Splits,
    domains: tuple[str, str],
    chain: list[dict[str, Any]],
    command: str,
) -> None:
    weights = replace(pack_weights(result.network), contract=contract)
    with edit(root) as draft:
        for table in ("model", "run"):
            check_name_free(draft, table, name)
        trained_by = f"{result.provenance['recipe']}: {command}"
        register_model(root, draft, name, weights, result.convention, trained_by)
        insert_run(draft, name, name, domains, {"sim": chain, "real": []})
        splits = {f"split:{d}": encode_split(codes) for d, codes in codes_by_domain.items()}
        draft.set_provenance(f"model:{name}", {**result.provenance, **splits, "command": command})

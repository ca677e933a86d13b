"""Pretrained models that come with the program, trained on the synthetic world by `s2r train`.

A JSON file beside each weights file records recipe, seed, data hash and metrics. Both are written
by `python -m s2rtools.training.pretrained STORE ...`, from stores in which models were trained.
"""

from __future__ import annotations

import hashlib
import json
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import layout, safe_files
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.models.model_registration import DEFAULT_CONVENTIONS, read_weights, register_model
from s2rtools.precompute.run_registration import find_domain, insert_run
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe

PRETRAINED_MODELS = ("vanilla", "dataaug", "finetune", "perlin")
WORLD_SEED = 1
"""Seed of the building on which they were trained."""
FOLDER = Path(str(files("s2rtools.training"))) / "checkpoints"
GOLDEN = FOLDER / "golden.npz"
"""Views of the world at the time of their training."""


def model_description(name: str) -> dict[str, Any]:
    """Recipe, seed, steps, data hash and metrics by side and split of a pretrained model."""
    description: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text())
    return description


def add_pretrained_models(root: Path) -> list[str]:
    """Register the missing pretrained models, each with a run; return their names.

    Raises RequestError if the store is not the world on which they were trained.
    """
    with s2rstore.open(root) as store:
        recipe = store.provenance_object("world", "recipe")
        if recipe.get("seed") != WORLD_SEED:
            raise RequestError(
                f"{root}: the pretrained models fit the world of --seed {WORLD_SEED} only; "
                "train your own with `s2r train`"
            )
        models = {name: model.sha256 for name, model in store.models.items()}
        runs = {name: run.model for name, run in store.runs.items()}
        domains = find_domain(store, "sim", None), find_domain(store, "real", None)
    added = []
    for name in PRETRAINED_MODELS:
        description = model_description(name)
        weights = read_weights(FOLDER / f"{name}.safetensors", description["architecture"])
        if models.get(name, weights.sha256) != weights.sha256 or runs.get(name, name) != name:
            raise RequestError(f"{root}: {name!r} is used for something else; the "
                               "pretrained model needs that name")  # fmt: skip
        if name in models and name in runs:
            continue
        with edit(root) as draft:
            if name not in models:
                convention = DEFAULT_CONVENTIONS[description["architecture"]]
                register_model(
                    root, draft, name, weights, convention, f"{name}: {description['command']}"
                )
                draft.set_provenance(f"model:{name}", description)
            if name not in runs:
                insert_run(draft, name, name, domains)
        added.append(name)
    return added


def export_model(store: Store, name: str) -> None:
    """Write a trained model of a store and its description into the package."""
    if name not in store.models:
        raise RequestError(f"{store.path}: no model {name!r}")
    data = WorldData.of_store(store)
    if data is None or not data.matches(store):
        raise RequestError(f"{store.path}: this version renders other images; train again")
    model, notes = store.models[name], store.provenance(f"model:{name}")
    content = safe_files.read(store.path, f"{layout.MODELS}/{model.sha256}.safetensors")
    description = {
        key: _decode_value(text) for key, text in notes.items() if not key.startswith("split:")
    }
    recipe = store.provenance_object("world", "recipe")
    description["command"] = str(description["command"]).split(" --store")[0]
    description["golden"] = hashlib.sha256(GOLDEN.read_bytes()).hexdigest()
    description["data_hash"] = store.dataset.hash
    description["data"] = (
        f"s2r ingest world --survey {recipe['survey']} --instances {recipe['count']} "
        f"--seed {recipe['seed']}"
    )
    (FOLDER / f"{name}.safetensors").write_bytes(content)
    (FOLDER / f"{name}.json").write_text(json.dumps(description, indent=1, sort_keys=True) + "\n")


def golden_views() -> dict[str, NDArray[Any]]:
    """A few small views of the default building: colour, raw depth and ids of both sides."""
    data = WorldData(WorldRecipe(seed=WORLD_SEED, count=2, frame=48))
    poses = data.world.survey(4)
    arrays: dict[str, NDArray[Any]] = {}
    for side in SIDES:
        views = data.views(side, poses, np.arange(len(poses)))
        arrays |= {f"{side}_rgb": views.rgb, f"{side}_depth": data.raw_depth(views),
                 f"{side}_identity": views.identity}  # fmt: skip
    return arrays


def _decode_value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    views: dict[str, Any] = golden_views()
    np.savez_compressed(GOLDEN, **views)
    for path in sys.argv[1:]:
        with s2rstore.open(path) as opened:
            for chosen in PRETRAINED_MODELS:
                if chosen in opened.models:
                    export_model(opened, chosen)

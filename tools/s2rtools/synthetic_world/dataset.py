"""A world as a data set: its poses, its views on either side, and what a store notes about it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.input_files import parse_json
from s2rstore.geometry import angles
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtools.synthetic_world.factors import severities
from s2rtools.synthetic_world.renderer import Camera, Renderer, Views
from s2rtools.synthetic_world.routes import Poses
from s2rtools.synthetic_world.world import (
    TRAJECTORIES,
    facts,
    raw_depth,
    side_camera,
    through_sensor,
    world_of,
)

NOTES = "world"
SURVEY, TOUR = "survey", "tour"


@dataclass(frozen=True, slots=True)
class WorldRecipe:
    """All that a data set is made from; equal recipes give equal bytes.

    `count` instances on each of the two trajectories. A training set has `survey` random instances
    over the whole floor instead, and `count` on a tour of its own. `frame` is the side of the
    square images; `factors` are the severities of the real side.
    """

    seed: int = 1
    count: int = 120
    survey: int = 0
    frame: int = 128
    factors: Mapping[str, float] = field(default_factory=severities)

    def __post_init__(self) -> None:
        """Raises RequestError for counts that make no data set."""
        for number in (self.seed, self.count, self.survey, self.frame):
            if type(number) is not int:
                raise TypeError(f"{number!r} is no whole number")
        if not 0 <= self.seed < 2**31:
            raise RequestError(f"--seed {self.seed}: 0 .. 2147483647")
        if not 0 <= self.count <= 5000 or not 0 <= self.survey <= 200_000:
            raise RequestError("--instances: 0 .. 5000 for each trajectory; --survey: 0 .. 200000")
        if self.count < (0 if self.survey else 2):
            raise RequestError("--instances: at least 2")


class WorldData:
    """The instances of a recipe, and their views on demand."""

    def __init__(self, recipe: WorldRecipe) -> None:
        self.recipe = recipe
        self.world = world_of(recipe.seed)

    @classmethod
    def of_store(cls, store: Store) -> WorldData | None:
        """The world that a store was made from; None for other data."""
        notes = store.provenance(NOTES)
        if "recipe" not in notes:
            return None
        try:
            recipe = WorldRecipe(**parse_json(notes["recipe"], f"{store.path}: recipe"))
            frame = store.dataset.frame_height, store.dataset.frame_width
            if frame != (recipe.frame, recipe.frame):
                raise ValueError("another frame size")
            given = severities(recipe.factors)
            return cls(replace(recipe, factors={name: given[name] for name in recipe.factors}))
        except (TypeError, ValueError, AttributeError, RequestError) as error:
            raise RequestError(
                f"{store.path}: its note on the world's recipe makes no sense; ingest it again"
            ) from error

    @property
    def names(self) -> list[str]:
        """The trajectories, in order; a view's noise is seeded by its place in them."""
        if not self.recipe.survey:
            return list(TRAJECTORIES)
        return [SURVEY, TOUR] if self.recipe.count else [SURVEY]

    @cached_property
    def poses(self) -> dict[str, Poses]:
        """Poses (n, 3) of every trajectory by name: x, y in metres, heading in radians."""
        recipe = self.recipe
        if recipe.survey:
            tour = {TOUR: self.world.tour(recipe.count)} if recipe.count else {}
            return {SURVEY: self.world.survey(recipe.survey)} | tour
        return {name: self.world.poses(name, recipe.count) for name in TRAJECTORIES}

    def severities(self, side: Side) -> dict[str, float]:
        return dict(self.recipe.factors) if side == "real" else {}

    def views(
        self, side: Side, poses: Poses, numbers: NDArray[np.intp],
        camera: Camera | None = None,
    ) -> Views:  # fmt: skip
        """Views (n, h, w, ...) of some poses; `numbers` (n,) seed the noise of each.

        `camera` replaces the side's own; `camera(side).moved(...)` is one at another height, pitch
        or field of view.
        """
        views = self.renderer(side).render(poses, camera or self.camera(side))
        return through_sensor(views, self.severities(side), self.recipe.seed, numbers)

    def camera(self, side: Side) -> Camera:
        """The camera that a side really has."""
        return side_camera(self.recipe.frame, self.severities(side))

    def matches(self, store: Store) -> bool:
        """Whether what is rendered now is what the store holds, in a view of each trajectory.

        Processors round differently: a few pixels may.
        """
        for trajectory in store.trajectories:
            name, first = trajectory.trajectory, store.first_iid(trajectory.trajectory)
            row = trajectory.instances // 2
            if name not in self.names or row >= len(self.poses[name]):
                return False
            number = np.array([self.number(name, row)])
            for side in SIDES:
                made = self.views(side, self.poses[name][row : row + 1], number)
                held = store.frame(first + row, side)
                away = np.abs(made.rgb[0].astype(np.float32) - held.rgb)
                far = np.abs(self.raw(made)[0].astype(np.float32) - held.depth)
                if (away > 3).mean() > 0.01 or (far > 20).mean() > 0.01:
                    return False
        return True

    def number(self, name: str, row: int) -> int:
        """What seeds the noise of a view."""
        return 1_000_000 * self.names.index(name) + row

    def renderer(self, side: Side) -> Renderer:
        return self.world.renderer(self.severities(side))

    def raw(self, views: Views) -> NDArray[np.uint16]:
        """Depth as it is stored."""
        return raw_depth(views.depth)

    def odometry(self, name: str) -> Poses:
        """Wheel odometry of a trajectory: each step a little wrong, so that the error grows."""
        poses = self.poses[name]
        rng = np.random.default_rng([self.recipe.seed, 7, len(poses)])
        heading = poses[:, 2]
        turn = angles.wrap(np.diff(heading))
        moved = np.diff(poses[:, :2], axis=0)
        cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
        local = np.stack([moved[:, 0] * cos + moved[:, 1] * sin,
                          moved[:, 1] * cos - moved[:, 0] * sin], axis=1)  # fmt: skip
        local *= 1.02 + 0.03 * rng.standard_normal((len(local), 1))
        turn = turn * 0.985 + 0.004 * rng.standard_normal(len(turn))
        angle = heading[0] + np.concatenate([[0.0], np.cumsum(turn)])
        cos, sin = np.cos(angle[:-1]), np.sin(angle[:-1])
        steps = np.stack([local[:, 0] * cos - local[:, 1] * sin,
                          local[:, 0] * sin + local[:, 1] * cos], axis=1)  # fmt: skip
        at = poses[0, :2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        return np.concatenate([at, angles.wrap(angle)[:, None]], axis=1)

    def notes(self) -> dict[str, Any]:
        """What a store keeps in its provenance: the recipe, and the labelled changes."""
        recipe = asdict(self.recipe) | {"factors": dict(self.recipe.factors)}
        changed = set(self.world.changed(self.severities("real")))
        objects = [fact for fact in facts(self.world) if fact["object"] in changed]
        return {"recipe": recipe, "changes": objects}

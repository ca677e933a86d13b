"""A world as a data set: poses, rendered views of either side, and provenance for the store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.documents import parse_json
from s2rstore.geometry import angles
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtools.synthetic_world.factors import Factor, complete_severities, configured_factors
from s2rtools.synthetic_world.renderer import SAMPLES, Camera, RenderedViews, SceneRenderer
from s2rtools.synthetic_world.routes import Poses
from s2rtools.synthetic_world.world import (
    TRAJECTORIES,
    apply_sensor_factors,
    labelled_changes,
    side_camera,
    to_raw_depth,
    world_of,
)

PROVENANCE_SECTION = "world"
SURVEY, TOUR = "survey", "tour"


@dataclass(frozen=True, slots=True)
class WorldRecipe:
    """Parameters of a generated data set; equal recipes give equal bytes.

    There are `count` instances on each of the two trajectories. If `survey` is not 0, the data set
    is a training set: `survey` random instances over the whole floor and `count` on a separate
    tour. `frame` is the side of the square images; `factors` are the severities of the real side;
    `constants` replace constants of the factors, such as `exposure.vignette`.
    """

    seed: int = 1
    count: int = 120
    survey: int = 0
    frame: int = 128
    factors: Mapping[str, float] = field(default_factory=complete_severities)
    constants: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raises RequestError for counts out of range and unknown constants."""
        for number in (self.seed, self.count, self.survey, self.frame):
            if type(number) is not int:
                raise TypeError(f"{number!r} is not a whole number")
        if not 0 <= self.seed < 2**31:
            raise RequestError(f"--seed {self.seed}: 0 .. 2147483647")
        if not 0 <= self.count <= 5000 or not 0 <= self.survey <= 200_000:
            raise RequestError("--instances: 0 .. 5000 for each trajectory; --survey: 0 .. 200000")
        if self.count < (0 if self.survey else 2):
            raise RequestError("--instances: at least 2")
        configured_factors(self.constants)


class WorldData:
    """The instances of a recipe, with views rendered on request."""

    def __init__(self, recipe: WorldRecipe) -> None:
        self.recipe = recipe
        self.world = world_of(recipe.seed)
        self._factors: Mapping[str, Factor] = configured_factors(recipe.constants)

    @classmethod
    def of_store(cls, store: Store) -> WorldData | None:
        """The world that a store was made from; None if its data was not generated."""
        notes = store.provenance(PROVENANCE_SECTION)
        if "recipe" not in notes:
            return None
        try:
            recipe = WorldRecipe(**parse_json(notes["recipe"], f"{store.path}: recipe"))
            frame = store.dataset.frame_height, store.dataset.frame_width
            if frame != (recipe.frame, recipe.frame):
                raise ValueError("another frame size")
            factors = complete_severities(recipe.factors)
            return cls(replace(recipe, factors={name: factors[name] for name in recipe.factors}))
        except (TypeError, ValueError, AttributeError, RequestError) as error:
            raise RequestError(
                f"{store.path}: the stored recipe of the world is invalid; ingest it again"
            ) from error

    @property
    def names(self) -> list[str]:
        """The trajectories in order; the order determines the noise of each view."""
        if not self.recipe.survey:
            return list(TRAJECTORIES)
        return [SURVEY, TOUR] if self.recipe.count else [SURVEY]

    @cached_property
    def poses(self) -> dict[str, Poses]:
        """Poses (n, 3) by trajectory: x, y in metres, heading in radians."""
        recipe = self.recipe
        if recipe.survey:
            tour = {TOUR: self.world.tour(recipe.count)} if recipe.count else {}
            return {SURVEY: self.world.survey(recipe.survey)} | tour
        return {name: self.world.poses(name, recipe.count) for name in TRAJECTORIES}

    def severities(self, side: Side) -> dict[str, float]:
        return dict(self.recipe.factors) if side == "real" else {}

    def views(
        self, side: Side, poses: Poses, numbers: NDArray[np.intp],
        camera: Camera | None = None, samples: int = SAMPLES,
        lights: tuple[float, float] = (1.0, 1.0),
    ) -> RenderedViews:  # fmt: skip
        """Views (n, h, w, ...) of poses; `numbers` (n,) seed the noise of each.

        `camera` replaces the side's camera; `camera(side).moved(...)` changes its height, pitch or
        field of view. `samples` is as in `SceneRenderer`; `lights` are factors of the light of
        lamps and windows.
        """
        renderer = self.world.lit_renderer(self.severities(side), *lights)
        views = renderer.render(poses, camera or self.camera(side), samples)
        return self.sensed(views, self.severities(side), numbers)

    def camera(self, side: Side) -> Camera:
        """The true camera of a side."""
        return self.camera_with(self.severities(side))

    def camera_with(self, severities: Mapping[str, float], frame: int = 0) -> Camera:
        """The simulator's camera as some factors change it; `frame` 0 is that of the recipe."""
        return side_camera(frame or self.recipe.frame, severities, self._factors)

    def sensed(
        self, views: RenderedViews, severities: Mapping[str, float], numbers: NDArray[np.intp]
    ) -> RenderedViews:
        """Rendered views after the sensor effects of some factors; `numbers` seed the noise."""
        seed = self.recipe.seed
        return apply_sensor_factors(views, severities, seed, numbers, self._factors)

    def matches(self, store: Store) -> bool:
        """Whether one rendered view of each trajectory equals the stored frame.

        A few differing pixels are accepted, because processors round differently.
        """
        for trajectory in store.trajectories:
            name, row = trajectory.trajectory, trajectory.instances // 2
            if name not in self.names or row >= len(self.poses[name]):
                return False
            iid = int(store.iids_of(name)[row])
            number = np.array([self.noise_number(name, row)])
            for side in SIDES:
                views = self.views(side, self.poses[name][row : row + 1], number)
                stored = store.frame(side, iid)
                rgb_difference = np.abs(views.rgb[0].astype(np.float32) - stored.rgb)
                raw = self.raw_depth(views)[0].astype(np.float32)
                depth_difference = np.abs(raw - stored.depth)
                if (rgb_difference > 3).mean() > 0.01 or (depth_difference > 20).mean() > 0.01:
                    return False
        return True

    def noise_number(self, name: str, row: int) -> int:
        """Seed of the noise of a view."""
        return 1_000_000 * self.names.index(name) + row

    def noise_numbers(self, store: Store) -> NDArray[np.intp]:
        """Seeds of the noise of all instances of a store, (N,)."""
        numbers = np.empty(len(store.instances), dtype=np.intp)
        for name in store.instances.trajectory_names:
            iids = store.iids_of(name)
            numbers[iids] = self.noise_number(name, 0) + np.arange(iids.size)
        return numbers

    def renderer(self, side: Side) -> SceneRenderer:
        return self.world.renderer(self.severities(side))

    def raw_depth(self, views: RenderedViews) -> NDArray[np.uint16]:
        """Depth in the units of the store."""
        return to_raw_depth(views.depth)

    def odometry(self, name: str) -> Poses:
        """Simulated wheel odometry of a trajectory, with an error that grows step by step."""
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
        drifted = np.concatenate([at, angles.wrap(angle)[:, None]], axis=1)
        return np.round(drifted, 9)  # the last digits differ between processors

    def provenance(self) -> dict[str, Any]:
        """The recipe and the labelled changes, for the store's provenance."""
        recipe = asdict(self.recipe) | {"factors": dict(self.recipe.factors)}
        if not self.recipe.constants:
            del recipe["constants"]
        changed = set(self.world.changed_objects(self.severities("real")))
        objects = [item for item in labelled_changes(self.world) if item["object"] in changed]
        return {"recipe": recipe, "changes": objects}

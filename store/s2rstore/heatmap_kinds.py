"""The heatmap kinds: what each shows, how far it can be trusted, and facts that readers need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

NO_HEAT = "none"
"""The kind that stands for plain images."""
SHIPPED_PLACE = "4 synthetic buildings"
"""Where the shipped scores were measured; see docs/explanation/heatmaps.md."""


_HARM_PLANES = {"position": "m", "heading": "rad", "loss": "loss"}


@dataclass(frozen=True, slots=True)
class HeatmapFacts:
    """Facts about one heatmap kind.

    `shows` says what its values mean, and what they do not. `auroc` is how well each mode finds
    changed objects on the floor of `SHIPPED_PLACE`: the mean AUROC over buildings and the models
    vanilla, dataaug and finetune, from docs/explanation/heatmaps.md; a kind without a figure is
    hardly better than chance. `harm_auroc` is how well it finds the objects that cost the
    prediction more than 0.25 m, pooled over the pretrained models in the demo's building; known of
    the kinds that are made for it. `planes` names the maps along the first axis of its arrays,
    which are its modes, with their units. `sums_up`: the heat of a region sums to what the region
    costs, in the unit of the mode. `is_slow`: it is not computed while images are adjusted.
    """

    name: str
    shows: str
    auroc: Mapping[str | None, float] = field(default_factory=dict)
    harm_auroc: float | None = None
    default_mode: str | None = None
    planes: Mapping[str, str] = field(default_factory=dict)
    is_signed: bool = False
    sums_up: bool = False
    needs_network: bool = False
    is_slow: bool = False

    @property
    def modes(self) -> tuple[str, ...]:
        """The modes of a kind with planes, the default one first."""
        return tuple(sorted(self.planes, key=lambda mode: mode != self.default_mode))


HEATMAPS: dict[str, HeatmapFacts] = {
    facts.name: facts
    for facts in (
        HeatmapFacts(
            "harmonised_distance",
            "what changed between sim and real, not what harms",
            auroc={None: 0.97}, needs_network=True,
        ),
        HeatmapFacts(
            "harmonised_difference",
            "changed colours and depths, not what harms",
            auroc={None: 0.97},
        ),
        HeatmapFacts(
            "pixel_difference",
            "pixels that differ without alignment, not what harms",
            auroc={"rgb": 0.84, "depth": 0.71}, default_mode="rgb",
        ),
        HeatmapFacts(
            "feature_distance",
            "where the last features differ, not what harms",
            auroc={None: 0.83}, needs_network=True,
        ),
        HeatmapFacts(
            "occlusion",
            "how a patch of the other side changes the error, not what changed",
            default_mode="rgbd", is_signed=True, needs_network=True, is_slow=True,
        ),
        HeatmapFacts(
            "activation",
            "features that raise the output or loss, not what changed",
            default_mode="loss",
            planes={"x": "m", "y": "m", "heading": "rad", "loss": "loss"},
            is_signed=True, needs_network=True,
        ),
        HeatmapFacts(
            "harm",
            "what each changed segment costs this prediction",
            harm_auroc=0.95,
            default_mode="position", planes=_HARM_PLANES,
            is_signed=True, sums_up=True, needs_network=True, is_slow=True,
        ),
        HeatmapFacts(
            "harm_fine",
            "what each pixel that differs costs this prediction, noise included",
            harm_auroc=0.92,
            default_mode="position", planes=_HARM_PLANES,
            is_signed=True, sums_up=True, needs_network=True, is_slow=True,
        ),
        HeatmapFacts(NO_HEAT, "plain images"),
    )
}  # fmt: skip
"""By name; kinds with equal scores are offered in this order."""


def heatmap_facts(kind: str) -> HeatmapFacts:
    """The facts of a kind; a kind that is not registered has neither text nor score."""
    return HEATMAPS.get(kind, HeatmapFacts(kind, ""))

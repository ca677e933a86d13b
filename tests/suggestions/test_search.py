"""The search on costs whose minimum is known, and the mismatch of image pairs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtools.suggestions import image_mismatch
from s2rtools.suggestions.search import Candidate, Search, net_gain, pareto_front, preferred
from s2rtools.suggestions.sliders import TRANSLATOR, Slider

N = 12


def slider(name: str, base: float = 0.0, low: float = -1.0, high: float = 1.0, **more) -> Slider:
    return Slider(name, more.pop("factor", name), "m", base, low, high, 3, **more)


def bowl(targets: dict[str, float], coupled: float = 0.0):
    """Costs whose minimum is at `targets`; `coupled` ties the first two sliders."""
    spread = np.linspace(0.5, 1.5, N)

    def costs(values):
        offsets = [values.get(name, 0.0) - target for name, target in targets.items()]
        cost = sum(offset**2 for offset in offsets)
        if coupled:
            cost += coupled * offsets[0] * offsets[1]
        return spread * (cost + 0.1)

    return costs


def searched(costs, sliders, **more):
    options = {"price": 0.02, "most_changes": 4, "evaluations": 120, "seed": 1, **more}  # fmt: skip
    return Search(costs, sliders, **options).run()


def test_the_screening_names_the_slider_that_helps_most_first():
    result = searched(bowl({"a": 0.1, "b": -0.6}), [slider("a"), slider("b"), slider("c")])
    assert [each.slider.name for each in result.screening] == ["b", "a", "c"]
    assert result.screening[0].value == pytest.approx(-0.6, abs=0.01)
    assert result.screening[2].value == 0.0


def test_coupled_values_are_fitted_together():
    result = searched(bowl({"a": 0.4, "b": -0.5}, coupled=1.2), [slider("a"), slider("b")])
    values = result.candidates[2].values
    assert values["a"] == pytest.approx(0.4, abs=0.02)
    assert values["b"] == pytest.approx(-0.5, abs=0.02)


def test_a_change_that_later_ones_replace_is_removed():
    """`c` helps most alone, but a and b together leave nothing to it."""

    def costs(values):
        a, b, c = (values.get(name, 0.0) for name in "abc")
        return np.full(N, (a + c - 0.5) ** 2 + (b + c - 0.5) ** 2 + 0.3 * c**2 + 0.01)

    result = searched(costs, [slider("a"), slider("b"), slider("c")], most_changes=3)
    assert result.screening[0].slider.name == "c"
    assert set(result.candidates[2].values) == {"a", "b"}
    assert result.candidates[2].cost == pytest.approx(0.01, abs=0.003)


def test_unchanged_values_of_the_run_are_no_change():
    at_base = slider("a", base=0.25)
    result = searched(lambda values: np.full(N, 1.0 + len(values)), [at_base, slider("b")])
    assert not any(candidate.cost < result.start for candidate in result.candidates.values())
    assert pareto_front(result.candidates.values(), result.start) == []


def test_a_cost_of_zero_needs_no_search():
    result = searched(lambda values: np.zeros(N), [slider("a")])
    assert (result.evaluations, result.candidates) == (1, {})


def test_equal_seeds_give_equal_results():
    costs = bowl({"a": 0.3, "b": -0.2, "c": 0.7}, coupled=0.8)
    sliders = [slider("a"), slider("b"), slider("c")]
    first, second, other = (searched(costs, sliders, seed=seed) for seed in (3, 3, 4))
    assert first.candidates == second.candidates
    assert first.evaluations == second.evaluations
    assert first.candidates[1] == other.candidates[1]  # one change needs no random numbers


def test_a_search_that_runs_out_of_time_keeps_what_it_has_found():
    sliders = [slider("a"), slider("b")]
    result = searched(bowl({"a": 0.5, "b": 0.5}), sliders, has_time=lambda: False)
    assert not result.complete
    assert result.evaluations == 1


def test_two_translators_are_never_joined():
    sliders = [
        slider(name, low=0.0, factor=TRANSLATOR, screened=(0.5, 1.0)) for name in ("t1", "t2")
    ] + [slider("a")]
    costs = bowl({"t1": 0.6, "t2": 0.5, "a": 0.2})
    for candidate in searched(costs, sliders).candidates.values():
        assert not {"t1", "t2"} <= set(candidate.values)


@given(st.floats(-0.95, 0.95), st.booleans())
def test_a_single_value_is_found_within_a_few_steps(target, logarithmic):
    if logarithmic:
        wanted = 2.0**target
        one = slider("a", base=1.0, low=0.4, high=2.5, logarithmic=True)
    else:
        wanted, one = target, slider("a")
    result = searched(lambda values: np.full(N, abs(values.get("a", one.base) - wanted)), [one])
    found = [each.value for each in result.screening] or [one.base]
    assert found == [pytest.approx(wanted, abs=0.03)]


candidates = st.lists(
    st.builds(
        Candidate,
        st.sets(st.sampled_from("abcdef"), min_size=1).map(lambda names: dict.fromkeys(names, 1.0)),
        st.floats(0, 2),
    ),
    max_size=12,
)


@given(candidates, st.floats(0.1, 2))
def test_the_front_is_sorted_and_not_dominated(made, start):
    front = pareto_front(made, start)
    changes, costs = [c.changes for c in front], [c.cost for c in front]
    assert changes == sorted(set(changes))
    assert costs == sorted(set(costs), reverse=True)
    for candidate in made:
        if candidate.cost < start:
            assert any(c.changes <= candidate.changes and c.cost <= candidate.cost for c in front)
    assert all(candidate.cost < start for candidate in front)


@given(candidates, st.floats(0.1, 2), st.floats(0, 0.5))
def test_the_preferred_answer_pays_its_price_and_gains_most(made, start, price):
    front = pareto_front(made, start)
    place = preferred(front, start, price)
    gains = [net_gain(candidate, start, price) for candidate in front]
    if place is None:
        assert all(gain <= 0 for gain in gains)
    else:
        assert gains[place] == max(gains) > 0


def test_the_price_makes_one_change_beat_several():
    one, two = Candidate({"a": 1.0}, 0.50), Candidate({"a": 1.0, "b": 1.0}, 0.47)
    assert preferred([one, two], 1.0, 0.02) == 1
    assert preferred([one, two], 1.0, 0.05) == 0
    assert preferred([one, two], 1.0, 0.60) is None


PAIRS, SIZE = 3, 64
COLUMNS = {"colour": slice(0, 768), "depth": slice(768, 1024), "missing": slice(1024, 1040),
           "noise": slice(1040, 1043)}  # fmt: skip


@pytest.fixture
def images():
    rng = np.random.default_rng(2)
    u, v = np.meshgrid(np.linspace(0, 5, SIZE), np.linspace(0, 3, SIZE))
    phase = rng.random((PAIRS, 1, 1)) * 6
    rgb = 120 + 60 * np.sin(u + phase)[..., None] * np.array([1.0, 0.8, 0.6])
    depth = 2.5 + 1.5 * np.cos(v + phase)
    return rgb.astype(np.uint8), depth.astype(np.float32), np.ones((PAIRS, SIZE, SIZE), dtype=bool)


def changed(images, other):
    difference = image_mismatch.residuals(other, images)
    return {name: float(np.abs(difference[:, part]).max()) for name, part in COLUMNS.items()}


def test_equal_images_have_no_mismatch(images):
    difference = image_mismatch.residuals(images, images)
    assert difference.shape == (PAIRS, image_mismatch.weights().size)
    np.testing.assert_array_equal(difference, 0)
    np.testing.assert_array_equal(image_mismatch.cost(difference, image_mismatch.weights()), 0)


def test_brighter_images_differ_in_colour_alone(images):
    rgb, depth, valid = images
    found = changed(images, (np.clip(rgb * 1.2, 0, 255).astype(np.uint8), depth, valid))
    assert found["colour"] > 1
    assert (found["depth"], found["missing"], found["noise"]) == (0, 0, 0)


def test_longer_depth_differs_by_its_logarithm(images):
    rgb, depth, valid = images
    difference = image_mismatch.residuals((rgb, depth * 1.1, valid), images)
    np.testing.assert_allclose(difference[:, COLUMNS["depth"]], np.log(1.1) / 0.05, rtol=1e-4)
    assert np.abs(difference[:, COLUMNS["colour"]]).max() == 0


def test_noise_of_depth_is_seen_whatever_its_draw(images):
    rgb, depth, valid = images
    rng = np.random.default_rng(3)
    first, second = (
        (rgb, (depth * (1 + 0.03 * rng.standard_normal(depth.shape))).astype(np.float32), valid)
        for _ in range(2)
    )
    assert changed(images, first)["noise"] > 3
    assert changed(first, second)["noise"] < 0.5


def test_missing_depth_counts_as_missing_and_not_as_wrong(images):
    rgb, depth, valid = images
    holes = valid.copy()
    holes[:, :20] = False
    found = changed(images, (rgb, np.where(holes, depth, 0), holes))
    assert found["missing"] > 3
    assert found["depth"] == 0


def test_models_without_a_channel_compare_the_others_only(images):
    rgb, depth, valid = images
    other = rgb, depth * 2, valid
    assert image_mismatch.residuals(other, images, "rgb").shape == (PAIRS, 768)
    np.testing.assert_array_equal(image_mismatch.residuals(other, images, "rgb"), 0)
    assert image_mismatch.residuals(other, images, "depth").shape == (PAIRS, 275)
    for channels in ("rgb", "depth", "rgbd"):
        columns = image_mismatch.residuals(other, images, channels).shape[1]
        assert image_mismatch.weights(channels).size == columns

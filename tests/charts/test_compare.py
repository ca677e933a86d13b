"""The compare view: differences of two runs compared with direct subtraction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rstore import intervals
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.language import parse
from s2rstore.language.name_resolution import uses_predictions
from s2rtui.charts.compare import CompareInput, compare_drawing
from s2rtui.charts.shared.run_changes import room_changes, sentences
from s2rtui.drawing.plane_marks import Floor
from tests.charts.examples import BOUNDS, N, columns, draw_compare, map_place

SIZE = (80, 26)
errors = arrays.arrays(np.float64, N, elements=st.floats(0, 4) | st.just(np.nan))
masks = arrays.arrays(np.bool_, N)


def test_colours_diverge_at_zero():
    """The second run is better at the left, the first in the middle, neither at the right."""
    everyone, truth = np.ones(3, dtype=np.bool_), [[4.0, 5.0], [10.0, 5.0], [16.0, 5.0]]
    view = CompareInput(
        columns(truth), np.array([3.0, 0.5, 1.0]), np.array([1.0, 1.5, 1.04]), everyone, everyone,
        Floor(BOUNDS), ("vanilla", "dataaug"),
    )  # fmt: skip
    canvas, place = draw_compare(view, SIZE), map_place(compare_drawing(view), SIZE)
    worse, better, equal = (canvas.fg[cell].astype(int) for cell in place.cells(truth))
    assert better[0] > better[2] + 80
    assert worse[2] > worse[0] + 80
    assert np.ptp(equal) < 60


@given(errors, errors, masks, arrays.arrays(np.int64, N, elements=st.integers(-1, 2)))
def test_changes_by_room_equal_direct_computation(first, second, members, room):
    changes = room_changes(first, second, members, None, room, ("a", "b", "c"))
    known = members & np.isfinite(first) & np.isfinite(second)
    parts = {"a": room == 0, "b": room == 1, "c": room == 2, "no room": room == -1}
    assert [name for name, _ in changes.rooms] == [
        name for name, inside in parts.items() if (known & inside).any()
    ]
    for name, part in (*changes.rooms, ("all", changes.whole)):
        inside = known & parts.get(name, True)
        one, two = first[inside], second[inside]
        assert part.n == inside.sum()
        if part.n:
            assert part.first == pytest.approx(np.median(one))
            assert part.second == pytest.approx(np.median(two))
            assert part.change.value == pytest.approx(np.median(two - one))
            assert part.large == pytest.approx(np.mean(np.abs(two - one) > 0.5))
        assert part.better == (two - one < -0.05).sum()
        assert part.worse == (two - one > 0.05).sum()


@pytest.mark.parametrize(
    ("expression", "is_judged"),
    [
        ("all", True), ("room:a & heading:0..45 & !traj:t1", True),
        ("worst15", False), ("curvature >= 10 & sim.error < 1", False), ("like(3, 20)", False),
    ],
)  # fmt: skip
def test_selections_by_predictions_give_no_verdict(expression, is_judged):
    """Those on which A is the worst by chance would make B look better."""
    assert uses_predictions(parse(expression)) != is_judged
    everyone = np.ones(400, dtype=bool)
    better, worse = np.random.default_rng(0).uniform((0, 2), (1, 3), (400, 2)).T
    changes = room_changes(worse, better, everyone, None, None, (), is_judged=is_judged)
    assert changes.whole.better_run == ("B" if is_judged else "")
    assert ("evidently" in sentences(changes.whole, ("a", "b"), "real")) == is_judged


def test_changes_of_many_instances_are_those_of_their_members():
    """Above 20,000 values numbers come from sorted columns."""
    rng = np.random.default_rng(8)
    n = 60_000
    first, second = rng.gamma(2.0, size=(2, n))
    first[rng.random(n) < 0.01] = np.nan
    room, trajectory = rng.integers(-1, 2, n), np.arange(n) % 7
    members = rng.random(n) < 0.8
    changes = room_changes(first, second, members, trajectory, room, ("a", "b"))
    known = np.flatnonzero(members & np.isfinite(first))
    known = known[np.argsort(trajectory[known], kind="stable")]
    parts = {"a": room == 0, "b": room == 1, NO_ROOM: room == -1}
    assert [name for name, _ in changes.rooms] == list(parts)
    for name, part in (("all", changes.whole), *changes.rooms):
        rows = known[parts[name][known]] if name in parts else known
        apart = second[rows] - first[rows]
        assert part.change == intervals.median(apart, trajectory[rows])
        assert (part.n, part.first, part.second) == (
            rows.size, np.median(first[rows]), np.median(second[rows]),
        )  # fmt: skip
        assert (part.better, part.worse) == ((apart < -0.05).sum(), (apart > 0.05).sum())
        assert part.large == np.mean(np.abs(apart) > 0.5)
        assert part.first_mean == pytest.approx(first[rows].mean())
        assert part.second_mean == pytest.approx(second[rows].mean())


def test_a_clear_change_is_evident_and_said_in_words():
    random = np.random.default_rng(8)
    first = random.gamma(3, 1, 400)
    second = first - 0.4 + random.normal(0, 0.3, 400)
    everything = np.ones(400, dtype=np.bool_)
    trajectory = np.arange(400) // 100
    whole = room_changes(first, second, everything, trajectory, None, ()).whole
    assert whole.better_run == "B"
    assert whole.change.low < whole.change.value < whole.change.high < 0
    text = sentences(whole, ("vanilla", "dataaug"), "real")
    assert f"dataaug is better on {whole.better} of 400 instances, worse on {whole.worse}" in text
    assert "negative: dataaug is better), so dataaug is evidently better" in text
    assert f"{100 * whole.large:.0f} % of the instances change by more than 0.5 m" in text
    back = room_changes(second, first, everything, trajectory, None, ()).whole
    assert (back.better_run, back.better, back.worse) == ("A", whole.worse, whole.better)
    assert back.change.value == pytest.approx(-whole.change.value)
    same = room_changes(first, first[::-1].copy(), everything, trajectory, None, ()).whole
    assert same.better_run == ""
    assert "no evident difference" in sentences(same, ("vanilla", "dataaug"), "real")

"""Suggestions for expressions that select nothing: they parse, and they select what they say."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.language import MaskContext, mask, parse, to_text
from s2rstore.language import syntax_tree as n
from s2rstore.language.widening import MAX_TERMS, MAX_WORK, widenings
from tests.support.columns import mask_context

N = 50
NUMBERS = st.floats(-12, 12, allow_nan=False).map(lambda value: round(value, 2))
FIELDS = st.sampled_from(["sim.error", "real.error", "x", "y", "heading", "gap", "iid"]).map(
    lambda name: n.Field(name)
)


def _between(field: n.Field, a: float, b: float) -> n.Node:
    return n.Between(field, a, b) if field.name == "heading" else n.Between(
        field, min(a, b), max(a, b)
    )  # fmt: skip


def _box(a: float, b: float, c: float, d: float) -> n.Node:
    return n.Box(n.Field("x"), n.Field("y"), (min(a, c), min(b, d), max(a, c), max(b, d)))


LEAVES = st.one_of(
    st.builds(
        n.Extreme, st.sampled_from(["best", "worst"]), st.integers(0, 30).map(float),
        st.booleans(), FIELDS,
    ),
    st.builds(n.Compare, FIELDS, st.sampled_from(["<", "<=", ">", ">=", "=", "!="]), NUMBERS),
    st.builds(_between, FIELDS, NUMBERS, NUMBERS),
    st.builds(n.Around, FIELDS, NUMBERS, NUMBERS.map(abs)),
    st.builds(_box, NUMBERS, NUMBERS, NUMBERS, NUMBERS),
    st.builds(
        lambda x, y, r: n.Near(n.Field("x"), n.Field("y"), (x, y), r), NUMBERS, NUMBERS,
        NUMBERS.map(abs),
    ),
    st.builds(lambda i: n.Ids(((i, i),)), st.integers(0, N - 1)),
    st.just(n.Nothing()),
)  # fmt: skip
EXPRESSIONS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.builds(n.And, inner, inner), st.builds(n.And, inner, inner),
        st.builds(n.Minus, inner, inner), st.builds(n.Or, inner, inner), st.builds(n.Not, inner),
    ),
    max_leaves=5,
)  # fmt: skip


def context(seed: int = 1) -> MaskContext:
    random = np.random.default_rng(seed)
    sim, real = random.gamma(2, 1, N).round(1), random.gamma(2, 2, N)
    real[3] = np.nan
    return mask_context(
        N, np.arange(N) != 5, sim_error=sim, real_error=real, x=random.uniform(-10, 10, N),
        y=random.uniform(-10, 10, N), heading=random.uniform(-np.pi, np.pi, N),
    )  # fmt: skip


@given(EXPRESSIONS, st.integers(1, 4))
def test_a_suggestion_parses_and_selects_what_it_says(node, seed):
    columns = context(seed)
    if mask(node, columns).any():
        return
    found = widenings(node, columns)
    assert len(found) <= 2
    for widening in found:
        chosen = mask(parse(widening.text), columns)
        assert widening.count == chosen.sum() > 0
        assert parse(widening.text) == widening.node
        assert widening.text != to_text(node)
    assert [one.admitted for one in found] == sorted(one.admitted for one in found)


@given(st.integers(1, 30), st.integers(1, 30), st.integers(1, 9))
def test_a_percentage_is_the_smallest_step_that_selects_something(worst, best, seed):
    columns = context(seed)
    text = f"worst({worst}%, sim.error) & best({best}%, real.error)"
    if mask(parse(text), columns).any():
        return
    steps = [*range(1, 5), *range(5, 101, 5)]
    first = next(
        step for step in steps
        if step > best
        and mask(parse(f"worst({worst}%, sim.error) & best({step}%, real.error)"), columns).any()
    )  # fmt: skip
    changes = {one.change for one in widenings(parse(text), columns, most=9)}
    assert to_text(parse(f"best({first}%, real.error)")) in changes


@pytest.mark.parametrize(
    ("text", "change", "count"),
    [
        ("real.error >= 9 & ids(2)", "real.error >= 3", 1),
        ("real.error > 9 & ids(2)", "real.error > 2.9", 1),
        ("real.error < 0.5 & ids(1, 2)", "real.error < 2.1", 1),
        ("sim.error:7..9 & all", "sim.error:4..9", 1),
        ("near(20, 0, 3)", "near(20, 0, 17)", 1),
        ("heading:80..100", "heading:80..135", 1),
        ("heading:170..-170", "heading:135..-170", 1),
        ("heading:-60+-20", "heading:-60+-60", 1),
        ("box(5, 5, 9, 9)", "box(4, 4, 9, 9)", 1),
        ("worst(1, sim.error) & ids(0)", "worst(5, sim.error)", 1),
        ("gap = 7", "gap:7+-6", 4),
        ("all - all", "without - all", 5),
    ],
)
def test_the_nearest_instance_decides_how_far_a_term_is_widened(text, change, count):
    columns = mask_context(
        5, sim_error=np.arange(5.0), real_error=np.array([1.0, 2.0, 3.0, 4.0, 4.0]),
        x=np.arange(5.0), y=np.arange(5.0), heading=np.radians([0.0, 20.0, 30.0, 40.0, 135.0]),
    )  # fmt: skip
    assert not mask(parse(text), columns).any()
    found = {one.change: one for one in widenings(parse(text), columns, most=9)}
    assert change in found, list(found)
    assert found[change].count == count


@pytest.mark.parametrize("limit", ["9.5", "1000", "1e9"])
def test_a_bound_beyond_all_values_becomes_that_of_about_the_worst_15_percent(limit):
    errors = np.random.default_rng(2).gamma(2, 1, 200)
    columns = mask_context(200, sim_error=errors, real_error=errors)
    for text, own in ((f"real.error > {limit}", errors), (f"real.error < -{limit}", -errors)):
        (widening, *_) = widenings(parse(text), columns)
        (bound,) = (abs(leaf.value) for leaf in n.leaves(widening.node))
        assert 30 <= widening.count <= 36
        assert bound == pytest.approx(abs(np.sort(own)[-30]), abs=0.1)
        assert len(f"{bound:g}") <= 4  # two digits of the range of the values


def test_a_bound_of_equal_values_is_near_them():
    errors = np.full(20, 4.0)
    columns = mask_context(20, sim_error=errors, real_error=errors)
    (widening, *_) = widenings(parse("real.error > 1000"), columns)
    assert (widening.change, widening.count) == ("real.error > 3.9", 20)


def test_a_term_under_a_negation_is_left_out_as_a_whole():
    columns = context()
    found = widenings(parse("worst(20%, sim.error) & !worst(30%, sim.error)"), columns, most=9)
    changes = [one.change for one in found]
    assert "without !worst(30%, sim.error)" in changes
    assert all("!" not in change or change.startswith("without") for change in changes)
    assert widenings(parse("none"), columns) == []


def test_long_expressions_and_many_instances_are_not_widened():
    columns = context()
    long = " & ".join(f"x < {-20 - term}" for term in range(MAX_TERMS + 1))
    assert widenings(parse(long), columns) == []
    size = MAX_WORK // 2 + 1
    errors = np.zeros(size)
    many = mask_context(size, sim_error=errors, real_error=errors)
    assert widenings(parse("sim.error > 1 & real.error > 1"), many) == []
    assert math.isclose(widenings(parse("sim.error > 1"), many)[0].admitted, 1.0)


def test_a_suggestion_has_no_number_that_the_parser_refuses():
    values = np.full(N, 1.0)
    values[7] = 1e300
    wide = mask_context(N, np.ones(N, dtype=bool), sim_error=values, real_error=values)
    for text in ("sim.error > 1000 & real.error < 1", "sim.error > 5 - real.error:2+-1e12"):
        node = parse(text)
        for found in widenings(node, wide):
            assert parse(found.text) == found.node

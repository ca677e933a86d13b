"""The selection language: syntax, precedence, error messages and completion."""

import math

import numpy as np
import pytest

import s2rstore
from s2rstore.language import (
    ExpressionError,
    Vocabulary,
    base_population,
    complete,
    evaluation,
    parse,
    to_text,
)
from s2rstore.language.numpy_backend import mask
from s2rstore.reader import Store
from tests.support.columns import mask_context


@pytest.fixture(scope="module")
def store(tiny_store) -> Store:
    return s2rstore.open(tiny_store)


@pytest.mark.parametrize(
    ("text", "explicit"),
    [
        ("a.x > 1 | b", None),
        ("all | none & all", "all | (none & all)"),
        ("all - none & none", "(all - none) & none"),
        ("!all & none", "(!all) & none"),
        ("all & none - all | all", "((all & none) - all) | all"),
        ("min15", "worst15"),
        ("max15", "best(15%)"),
        ("gap > -1 - all", "(gap > -1) - all"),
    ],
)
def test_precedence(text, explicit):
    if explicit is None:
        with pytest.raises(ExpressionError):
            parse(text)
    else:
        assert parse(text) == parse(explicit)


@pytest.mark.parametrize(
    ("text", "column", "hint"),
    [
        ("worst15 &", 10, "ends too early"),
        ("real.eror > 1", 1, "real.error"),
        ("all all", 5, "unexpected"),
        ("worst(5%, sim_heading_error_rad)", 11, "could be sim.heading_error_deg"),
        ("box(1, 2)", 1, "x0, y0, x1, y1"),
        ("worst(120%)", 1, "0% .. 100%"),
        ("gap", 4, "needs a condition"),
        ("all & $", 7, "no meaning"),
        ("all & like(3)", 7, "like(123, 20)"),
        ("sim.like(3.5, 2)", 1, "sim.like(123, 20)"),
        ("like(3, 0)", 1, "neighbours"),
        ("like(gap, 4)", 1, "takes iid, k"),
        ("sim.lik(3, 4)", 1, "sim.like"),
        ("umap.sim.laso(1, 2)", 1, "umap.sim.lasso"),
        ("worst15 | lasso", 16, "needs ("),
    ],
)
def test_a_syntax_error_reports_its_column_and_a_hint(text, column, hint):
    with pytest.raises(ExpressionError, match="column") as caught:
        parse(text)
    assert caught.value.column == column
    assert hint in str(caught.value)


@pytest.mark.parametrize(
    ("text", "hint"),
    [("room:rihgt", "right"), ("traj:c", "a"), ('run("x").gap > 1', "vanilla"), ("@no", "saved")],
)
def test_unknown_names_are_rejected_with_a_suggestion(store, text, hint):
    with pytest.raises(ExpressionError, match=hint):
        evaluation.select(store, text)


def test_worst15_rounds_up_within_the_chosen_trajectories(store):
    errors = store.run_columns("vanilla").real.error
    for view, members in ((None, range(40)), (("a",), range(25)), (("b",), range(25, 40))):
        expected = sorted(members, key=lambda i: (-errors[i], i))[: math.ceil(0.15 * len(members))]
        selected = np.flatnonzero(evaluation.select(store, "worst15", "vanilla", view))
        assert selected.tolist() == sorted(expected)


def test_heading_intervals_wrap_around(store):
    degrees = np.degrees(store.instances.heading)
    for text, expected in (
        ("heading:170+-20", (np.abs((degrees - 170 + 180) % 360 - 180) <= 20)),
        ("heading:150..-150", (degrees >= 150) | (degrees <= -150)),
        ("heading:-180..180", np.ones(40, bool)),
    ):
        assert (evaluation.select(store, text) == expected).all(), text


def test_saved_selections_are_expanded_and_recursion_is_rejected(store):
    saved_expressions = {
        "bad": parse("worst15 & @far"),
        "far": parse("near(5, 4, 3)"),
        "loop": parse("!@loop"),
    }
    direct = evaluation.select(store, "worst15 & near(5, 4, 3)")
    assert (evaluation.select(store, "@bad", saved=saved_expressions) == direct).all()
    with pytest.raises(ExpressionError, match="contains itself"):
        evaluation.select(store, "@loop", saved=saved_expressions)


def test_fields_of_another_run_can_be_used(store):
    other = store.run_columns("dataaug").real.error > 1
    assert (evaluation.select(store, 'run("dataaug").real.error > 1', "vanilla") == other).all()


@pytest.mark.parametrize(
    ("text", "offered", "excluded"),
    [
        ("worst15 & lik", "like(", "lasso("),
        ("sim.", "sim.like(", "real.like("),
        ('run("vanilla").', "real.lasso(", "ids("),
        ('run("vanilla").sim.o', "sim.outlier", "sim.error"),
        ("run(", '"vanilla").', "all"),
        ('run("van', '"vanilla").', "all"),
        ("worst(15%, ", "sim.outlier", "worst15"),
        ("all & (", "all", ")"),
    ],
)
def test_completion_depends_on_the_context(text, offered, excluded):
    vocabulary = Vocabulary(("vanilla",), (), ())
    lines = [line for line, _ in complete(text, vocabulary)]
    assert any(line.endswith(offered) for line in lines)
    assert not any(line.endswith(excluded) for line in lines)


def test_numbers_are_not_completed():
    vocabulary = Vocabulary(("vanilla",), ("left (hall",), ())
    for text in ("like(", "like(12, ", "real.lasso(1, 2, ", "ids(3, "):
        assert complete(text, vocabulary) == []
    for text in ("real.error > ", "all & gap <", "heading:90 +- ", "seq:3..", "gap = -"):
        assert complete(text, vocabulary) == []
    assert complete('room:"left (hall" & hea', vocabulary)


@pytest.mark.parametrize(
    ("text", "completed"),
    [
        ("room:le", 'room:"left hall"'),
        ('room:"le', 'room:"left hall"'),
        ("all & room:left h", 'all & room:"left hall"'),
        ('all & room:"left h', 'all & room:"left hall"'),
        ("@tw", '@"two words"'),
        ('curved | @"two w', 'curved | @"two words"'),
    ],
)
def test_names_with_spaces_are_completed_and_quoted(text, completed):
    saved_expressions = {"two words": parse("all"), "other": parse("all")}
    vocabulary = Vocabulary(("vanilla",), ("left hall", "right"), ("a",), saved_expressions)
    assert [line for line, _ in complete(text, vocabulary)] == [completed]
    parse(completed)


@pytest.mark.parametrize(
    "text", ["worst15", "worst15 ", "room:right ", 'room:"left hall" ', "near(1, 2, 3)",
             "real.error > 0.8 ", "(all) ", "@bad "],
)  # fmt: skip
def test_operators_are_offered_after_a_complete_term(text):
    vocabulary = Vocabulary(("vanilla",), ("left hall", "right"), ("a",), {"bad": parse("all")})
    lines = [line for line, _ in complete(text, vocabulary)]
    assert len(lines) == 3
    for line in lines:
        parse(f"{line}all")


def test_shapes_have_short_names(store):
    for short, long in (
        ("umap.sim(0, 0, 3, 3)", "umap.sim.box(0, 0, 3, 3)"),
        ("real.like(3, 4)", "like(3, 4)"),
        ('run("dataaug").umap.real(1, 2, 3, 4)', 'run("dataaug").umap.real.box(1, 2, 3, 4)'),
    ):
        assert parse(short) == parse(long)
    assert to_text(parse("umap.sim.box(0, 0, 3, 3)")) == "umap.sim(0, 0, 3, 3)"


@pytest.mark.parametrize(
    ("text", "chosen"),
    [("near(0, 0, 5)", [0, 1, 2]), ("box(0, 0, 3, 4)", [0, 1]), ("box(3, 3, 4, 4)", [1, 2]),
     ("x:3..4", [1, 2]), ("x:2+-2", [0, 1, 2])],
)  # fmt: skip
def test_ends_belong_to_shapes_and_ranges(text, chosen):
    context = mask_context(4, x=[0.0, 3, 4, 9], y=[0.0, 4, 3, 9])
    assert np.flatnonzero(mask(parse(text), context)).tolist() == chosen


def test_a_returned_mask_is_a_copy(store):
    first = evaluation.select(store, "real.error > 1")
    first[:] = False
    assert evaluation.select(store, "real.error > 1").any()
    base = base_population(evaluation.context(store, trajectories=["a"]))
    with pytest.raises(ValueError, match="read-only"):
        base[0] = False


def test_cached_masks_are_separate_per_run_and_trajectories(store_copy):
    requests = [
        (text, run, view)
        for text in ("worst15", "gap > 0", "seq:3..9", "room:right", "real.lasso(0,0,9,0,5,8)")
        for run in ("vanilla", "dataaug")
        for view in (None, ("a",), ("b",))
    ]
    with s2rstore.open(store_copy) as shared:
        for text, run, view in [*requests, *requests]:
            with s2rstore.open(store_copy) as separate:
                expected = evaluation.select(separate, text, run, view)
            assert (evaluation.select(shared, text, run, view) == expected).all()
        assert 0 < shared.selection_cache.nbytes < 2**20

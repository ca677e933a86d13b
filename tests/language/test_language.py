"""The language's words, precedence and messages."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.language import (
    ExpressionError,
    Vocabulary,
    base_population,
    complete,
    evaluation,
    expand,
    parse,
    to_text,
)
from s2rstore.reader import Store


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
def test_precedence(text: str, explicit: str | None) -> None:
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
def test_a_wrong_expression_says_where_and_what_could_stand_there(
    text: str, column: int, hint: str
) -> None:
    with pytest.raises(ExpressionError, match="column") as caught:
        parse(text)
    assert caught.value.column == column
    assert hint in str(caught.value)


@pytest.mark.parametrize(
    ("text", "hint"),
    [("room:rihgt", "right"), ("traj:c", "a"), ('run("x").gap > 1', "vanilla"), ("@no", "saved")],
)
def test_unknown_names_are_refused_with_the_nearest_known(
    store: Store, text: str, hint: str
) -> None:
    with pytest.raises(ExpressionError, match=hint):
        evaluation.select(store, text)


def test_worst15_takes_the_ceiling_of_the_base_population_in_view(store: Store) -> None:
    errors = store.run_columns("vanilla").real.error
    for view, members in ((None, range(40)), (("a",), range(25)), (("b",), range(25, 40))):
        wanted = sorted(members, key=lambda i: (-errors[i], i))[: math.ceil(0.15 * len(members))]
        chosen = np.flatnonzero(evaluation.select(store, "worst15", "vanilla", view))
        assert chosen.tolist() == sorted(wanted)


def test_headings_turn_around(store: Store) -> None:
    degrees = np.degrees(store.instances.heading)
    for text, wanted in (
        ("heading:170+-20", (np.abs((degrees - 170 + 180) % 360 - 180) <= 20)),
        ("heading:150..-150", (degrees >= 150) | (degrees <= -150)),
        ("heading:-180..180", np.ones(40, bool)),
    ):
        assert (evaluation.select(store, text) == wanted).all(), text


def test_saved_selections_expand_and_may_not_contain_themselves(store: Store) -> None:
    saved = {"bad": parse("worst15 & @far"), "far": parse("near(5, 4, 3)"), "loop": parse("!@loop")}
    direct = evaluation.select(store, "worst15 & near(5, 4, 3)")
    assert (evaluation.select(store, "@bad", saved=saved) == direct).all()
    with pytest.raises(ExpressionError, match="contains itself"):
        evaluation.select(store, "@loop", saved=saved)


def test_another_runs_fields(store: Store) -> None:
    other = store.run_columns("dataaug").real.error > 1
    assert (evaluation.select(store, 'run("dataaug").real.error > 1', "vanilla") == other).all()


def test_completion_offers_only_what_goes_on() -> None:
    words = Vocabulary(("vanilla",), ("left hall", "right"), ("a",), {"bad": parse("all")})
    assert [line for line, _ in complete("worst15 & room:", words)] == [
        'worst15 & room:"left hall"',
        "worst15 & room:right",
    ]
    assert ("@bad", "saved") in complete("@", words)
    for line, _ in complete("real.", words):
        assert line.startswith("real.")
    assert to_text(expand(parse("@bad"), words)) == "all"


@pytest.mark.parametrize(
    ("text", "offered", "withheld"),
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
def test_completion_knows_where_it_stands(text: str, offered: str, withheld: str) -> None:
    words = Vocabulary(("vanilla",), (), ())
    lines = [line for line, _ in complete(text, words)]
    assert any(line.endswith(offered) for line in lines)
    assert not any(line.endswith(withheld) for line in lines)


def test_completion_leaves_numbers_to_the_user() -> None:
    words = Vocabulary(("vanilla",), ("left (hall",), ())
    for text in ("like(", "like(12, ", "real.lasso(1, 2, ", "ids(3, "):
        assert complete(text, words) == []
    for text in ("real.error > ", "all & gap <", "heading:90 +- ", "seq:3..", "gap = -"):
        assert complete(text, words) == []
    assert complete('room:"left (hall" & hea', words)


@pytest.mark.parametrize(
    ("text", "whole"),
    [
        ("room:le", 'room:"left hall"'),
        ('room:"le', 'room:"left hall"'),
        ("all & room:left h", 'all & room:"left hall"'),
        ('all & room:"left h', 'all & room:"left hall"'),
        ("@tw", '@"two words"'),
        ('curved | @"two w', 'curved | @"two words"'),
    ],
)
def test_names_with_blanks_are_completed_and_quoted(text: str, whole: str) -> None:
    saved = {"two words": parse("all"), "other": parse("all")}
    words = Vocabulary(("vanilla",), ("left hall", "right"), ("a",), saved)
    assert [line for line, _ in complete(text, words)] == [whole]
    parse(whole)


@pytest.mark.parametrize(
    "text", ["worst15", "worst15 ", "room:right ", 'room:"left hall" ', "near(1, 2, 3)",
             "real.error > 0.8 ", "(all) ", "@bad "],
)  # fmt: skip
def test_after_a_whole_term_comes_what_joins_it(text: str) -> None:
    words = Vocabulary(("vanilla",), ("left hall", "right"), ("a",), {"bad": parse("all")})
    lines = [line for line, _ in complete(text, words)]
    assert len(lines) == 3
    for line in lines:
        parse(f"{line}all")


def test_short_names_of_shapes(store: Store) -> None:
    for short, long in (
        ("umap.sim(0, 0, 3, 3)", "umap.sim.box(0, 0, 3, 3)"),
        ("real.like(3, 4)", "like(3, 4)"),
        ('run("dataaug").umap.real(1, 2, 3, 4)', 'run("dataaug").umap.real.box(1, 2, 3, 4)'),
    ):
        assert parse(short) == parse(long)
    assert to_text(parse("umap.sim.box(0, 0, 3, 3)")) == "umap.sim(0, 0, 3, 3)"


def test_a_mask_belongs_to_who_asked_for_it(store: Store) -> None:
    first = evaluation.select(store, "real.error > 1")
    first[:] = False
    assert evaluation.select(store, "real.error > 1").any()
    base = base_population(evaluation.context(store, trajectories=["a"]))
    with pytest.raises(ValueError, match="read-only"):
        base[0] = False


def test_masks_of_one_run_or_view_are_not_anothers(store_copy: Path) -> None:
    asked = [
        (text, run, view)
        for text in ("worst15", "gap > 0", "seq:3..9", "room:right", "real.lasso(0,0,9,0,5,8)")
        for run in ("vanilla", "dataaug")
        for view in (None, ("a",), ("b",))
    ]
    with s2rstore.open(store_copy) as shared:
        for text, run, view in [*asked, *asked]:
            with s2rstore.open(store_copy) as fresh:
                alone = evaluation.select(fresh, text, run, view)
            assert (evaluation.select(shared, text, run, view) == alone).all()
        assert 0 < shared.evaluated.nbytes < 2**20

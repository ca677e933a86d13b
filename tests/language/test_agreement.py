"""Numpy masks and SQL select the same instances for arbitrary expressions and data."""

import functools

import duckdb
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.language import ExpressionError, evaluation, fields, located, parse, to_text
from s2rstore.language import syntax_tree as n
from s2rstore.reader import Store
from tests.support import embeddings, tiny
from tests.support.copies import copy_store

NUMBERS = st.one_of(
    st.integers(-200, 200).map(float),
    st.floats(-12, 12, allow_nan=False).map(lambda v: round(v, 3)),
)
RUN_NAMES = st.sampled_from([None, None, "vanilla", "dataaug"])
NUMERIC = st.builds(n.Field, st.sampled_from(sorted(fields.NUMERIC)), RUN_NAMES)
PLANES = st.sampled_from(sorted(fields.PLANES.values()))
# Whole metres, so that corners coincide with grid points.
CORNERS = st.lists(
    st.tuples(*[st.one_of(st.integers(-2, 11).map(float), NUMBERS)] * 2), min_size=3, max_size=8
)


def _between(field: n.Field, a: float, b: float) -> n.Node:
    return n.Between(field, a, b) if fields.NUMERIC[field.name].angle else n.Between(
        field, min(a, b), max(a, b)
    )  # fmt: skip


def _named_strategy() -> st.SearchStrategy[n.Node]:
    values = {
        "rooms": st.sampled_from(["left hall", "right"]),
        "trajectories": st.sampled_from(["a", "b"]),
        "splits": st.sampled_from(["train", "validation", "test", "unseen"]),
        "domains": st.sampled_from(["sim", "real"]),
        "faults": st.sampled_from(["blurred", "frozen", "dark"]),
        "labels": st.sampled_from(["chair", "fire door"]),
    }
    return st.sampled_from(sorted(fields.TEXT)).flatmap(
        lambda name: st.builds(
            n.Named,
            st.builds(n.Field, st.just(name), RUN_NAMES),
            values[fields.TEXT[name].vocabulary],
        )
    )


def _box(plane: tuple[str, str], run: str | None, a: float, b: float, c: float, d: float) -> n.Node:
    corners = min(a, c), min(b, d), max(a, c), max(b, d)
    return n.Box(n.Field(plane[0], run), n.Field(plane[1], run), corners)


LEAVES = st.one_of(
    st.just(n.Everything()),
    st.just(n.Nothing()),
    st.builds(n.Bend, st.booleans()),
    st.builds(n.Paired, RUN_NAMES),
    st.builds(n.Training, st.booleans(), RUN_NAMES),
    st.builds(
        lambda a, b: n.Ids(((min(a, b), max(a, b)),)), st.integers(0, 50), st.integers(0, 50)
    ),
    st.builds(n.Compare, NUMERIC, st.sampled_from(["<", "<=", ">", ">=", "=", "!="]), NUMBERS),
    st.builds(_between, NUMERIC, NUMBERS, NUMBERS),
    st.builds(n.Around, NUMERIC, NUMBERS, NUMBERS.map(abs)),
    _named_strategy(),
    st.builds(
        n.Extreme, st.sampled_from(["worst", "best"]), st.integers(0, 100).map(float),
        st.booleans(), NUMERIC,
    ),
    st.builds(_box, PLANES, RUN_NAMES, NUMBERS, NUMBERS, NUMBERS, NUMBERS),
    st.builds(
        lambda plane, run, x, y, r: n.Near(
            n.Field(plane[0], run), n.Field(plane[1], run), (x, y), abs(r)
        ),
        PLANES, RUN_NAMES, NUMBERS, NUMBERS, NUMBERS,
    ),
    st.builds(
        lambda plane, run, corners: n.Lasso(
            n.Field(plane[0], run), n.Field(plane[1], run), tuple(corners)
        ),
        PLANES, RUN_NAMES, CORNERS,
    ),
    st.builds(
        n.LabelGain, st.sampled_from(["chair", "fire door"]), st.sampled_from(["<", "!=", ">="]),
        NUMBERS, RUN_NAMES,
    ),
    st.builds(
        n.Like, st.sampled_from(["sim", "real"]), st.integers(0, 47), st.integers(1, 60), RUN_NAMES
    ),
)  # fmt: skip
EXPRESSIONS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.builds(n.Not, inner),
        st.builds(n.And, inner, inner),
        st.builds(n.Minus, inner, inner),
        st.builds(n.Or, inner, inner),
    ),
    max_leaves=6,
)


@pytest.fixture(scope="module")
def store_with_missing_values(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A store with missing values and embeddings, ties, points on edges and a missing room."""
    path = tiny.build(tmp_path_factory.mktemp("holey") / "holey.s2r", n=48, trained=("vanilla",))
    with edit(path) as draft:
        draft._connection.execute(
            """UPDATE prediction SET x = NULL, y = NULL, heading = NULL, error = NULL,
               heading_error = NULL, loss = NULL, accuracy = NULL, rank = NULL
               WHERE iid % 7 = 3 AND side = 'real'"""
        )
        draft._connection.execute("UPDATE prediction SET error = round(error, 1)")
        draft._connection.execute("UPDATE prediction SET loss = 'NaN' WHERE iid % 11 = 5")
        draft._connection.execute("DELETE FROM projection WHERE iid % 5 = 1")
        draft._connection.execute("DELETE FROM prediction WHERE run = 'dataaug' AND iid = 20")
        draft._connection.execute("UPDATE instance SET room = NULL, curvature = NULL WHERE iid = 9")
        draft._connection.execute("UPDATE instance SET curvature = 10 WHERE iid = 12")
        draft._connection.execute("UPDATE prediction SET x = round(x), y = round(y) WHERE iid > 30")
        draft._connection.execute("UPDATE instance SET x = round(x), y = round(y) WHERE iid > 30")
        draft._connection.execute("UPDATE prediction SET outlier = NULL WHERE iid % 4 = 0")
        draft._connection.execute("UPDATE prediction SET sigma = error / 2 WHERE iid % 3 > 0")
        draft._connection.execute("UPDATE prediction SET split = NULL WHERE iid % 13 = 2")
        draft._connection.execute(
            """UPDATE prediction SET split = 'validation'
               WHERE iid % 6 = 4 AND run = 'dataaug' AND side = 'real'"""
        )
    rng = np.random.default_rng(5)
    for run in ("vanilla", "dataaug"):
        points = {side: rng.integers(0, 3, (48, 3)).astype(float) for side in ("sim", "real")}
        points["sim"][[4, 17, 31]] = np.nan
        points["real"][[9, 10]] = np.nan
        embeddings.add(path, run, points)
    return s2rstore.open(path)


@pytest.fixture(scope="module")
def store_with_unpaired_instances(
    store_with_missing_values: Store, tmp_path_factory: pytest.TempPathFactory
) -> Store:
    """The same store where no real image of trajectory b exists, and one run has no rows of it."""
    path = copy_store(store_with_missing_values.path, tmp_path_factory.mktemp("mixed") / "s.s2r")
    with edit(path) as draft:
        of_b = "iid IN (SELECT iid FROM instance WHERE trajectory = 'b')"
        draft._connection.execute(f"DELETE FROM frame WHERE domain = 'real' AND {of_b}")
        draft._connection.execute(f"DELETE FROM prediction WHERE run = 'vanilla' AND {of_b}")
        draft._connection.execute(
            f"""UPDATE prediction SET x = NULL, y = NULL, heading = NULL, error = NULL, rank = NULL,
                heading_error = NULL, loss = NULL, accuracy = NULL, split = NULL
                WHERE run = 'dataaug' AND {of_b}"""
        )
    return s2rstore.open(path)


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(node=EXPRESSIONS, run=st.sampled_from(["vanilla", "dataaug"]), with_trained=st.booleans(),
       view=st.sampled_from([None, ("a",), ("b",), ("a", "b")]))  # fmt: skip
def test_masks_and_sql_select_the_same_instances(
    store_with_missing_values, store_with_unpaired_instances, node, run, with_trained, view
):
    text = to_text(node)
    for store in (store_with_missing_values, store_with_unpaired_instances):
        mask = evaluation.select(store, text, run, view, with_trained=with_trained)
        selected = np.flatnonzero(mask)
        query, parameters = evaluation.sql(store, text, run, view, with_trained=with_trained)
        try:
            selected_by_sql = [row[0] for row in store.execute(query, parameters)]
        except duckdb.Error as error:
            raise AssertionError(f"{text}: {error}") from error
        assert selected_by_sql == selected.tolist(), text


def test_instances_without_a_real_image_are_selected_and_do_not_count(
    store_with_unpaired_instances,
):
    store = store_with_unpaired_instances
    for run in ("vanilla", "dataaug"):
        query = evaluation.query(store, "all", run)
        pairs, sim_only = query.selected.sum(), (store.instances.trajectory == 1).sum()
        assert query.count_text.startswith(f"{pairs} of ")
        assert " pairs" in query.count_text
        assert query.count_text.endswith(f", {sim_only} sim only")
        for text, count in (
            ("has:sim", pairs + sim_only), ("has:real", pairs), ("paired", pairs),
            ("!paired", sim_only), ("traj:b", sim_only), ("has:sim - has:real", sim_only),
            ("worst(100%)", pairs), ("new", pairs), ("trained", 0),
        ):  # fmt: skip
            assert evaluation.select(store, text, run).sum() == count, text


@given(node=EXPRESSIONS)
def test_the_text_of_a_tree_parses_to_the_same_tree(node):
    assert parse(to_text(node)) == node


@given(node=EXPRESSIONS, name=st.sampled_from(["done", "two words"]))
def test_a_located_tree_has_the_columns_of_its_text(node, name):
    for tree in (n.Or(node, n.Saved(name, 7)), n.Minus(n.Saved(name), n.Not(node))):
        placed, parsed = located(tree), parse(to_text(tree))
        assert placed == tree
        columns = [
            [getattr(leaf, "column", None) for leaf in n.leaves(each)] for each in (placed, parsed)
        ]
        assert columns[0] == columns[1], to_text(tree)


def test_a_long_chain_of_operators_is_compared():
    trees = [
        functools.reduce(n.Or, (n.Compare(n.Field("gap"), ">", float(i)) for i in range(1_000)))
        for _ in range(2)
    ]
    assert trees[0] == trees[1]
    assert trees[0] != n.And(trees[1].left, trees[1].right)
    assert len(set(trees)) == 1


@given(text=st.text(alphabet='worst15&|!-()@%:.,"<>=0123456789 aberlmox+', max_size=30))
def test_any_text_parses_or_reports_a_column(text):
    column = 1
    try:
        parse(text)
    except ExpressionError as error:
        column = error.column
    assert 1 <= column <= len(text) + 1


@given(node=EXPRESSIONS)
def test_the_complement_is_the_base_population_minus_the_selection(store_with_missing_values, node):
    text = to_text(node)
    selected, complement = (
        evaluation.select(store_with_missing_values, e, "vanilla") for e in (text, f"!({text})")
    )
    base = evaluation.select(store_with_missing_values, "all", "vanilla")
    assert not (selected & complement).any()
    assert ((selected | complement) == base).all()
    columns = store_with_missing_values.run_columns("vanilla")
    assert (base == columns.valid & ~columns.trained).all()
    everything = evaluation.select(store_with_missing_values, "all", "vanilla", with_trained=True)
    assert (everything == columns.valid).all()
    assert 0 < base.sum() < everything.sum()

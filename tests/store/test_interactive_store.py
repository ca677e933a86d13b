"""The store of scripts and notebooks: SQL relations, descriptions, figures."""

import sys
from io import BytesIO

import pytest
from PIL import Image

import s2rstore
from s2rstore import interactive_store
from s2rstore.errors import RequestError
from s2rstore.interactive_store import InteractiveStore
from s2rstore.metrics import run_metrics
from tests.support import tiny
from tests.support.refusals import refused


def test_sql_gives_a_relation_with_data_frames_that_writes_no_file(tiny_store, tmp_path):
    with s2rstore.open(tiny_store) as store:
        relation = store.sql("SELECT run, count(*) AS n FROM pair GROUP BY run ORDER BY run")
        frame = relation.df()
        assert relation.columns == ["run", "n"]
        assert frame["run"].tolist() == sorted(tiny.RUNS)
        assert relation.filter("run = 'vanilla'").fetchall() == [("vanilla", frame["n"].iloc[1])]
        with pytest.raises(Exception, match="Permission"):
            relation.write_csv(str(tmp_path / "rows.csv"))
    assert not list(tmp_path.glob("*.csv"))


@pytest.mark.parametrize(
    ("query", "reason"),
    [
        ("SELECT nothing FROM pair", "sql: Binder Error"),
        ("COPY pair TO 'rows.csv'", "only statements that read"),
        ("DELETE FROM pair", "only statements that read"),
        ("SET threads = 1", "only statements that read"),
        ("", "give a SELECT"),
    ],
)
def test_sql_refuses_what_does_not_read(tiny_store, query, reason):
    with s2rstore.open(tiny_store) as store, refused(match=reason):
        store.sql(query)


def test_the_description_names_data_set_domains_and_medians(tiny_store):
    with s2rstore.open(tiny_store) as store:
        text = repr(store)
        assert f"data set: {store.dataset.name}" in text
        assert "instances: 40" in text
        assert "trajectories: 2 (a, b)" in text
        assert f"generation: {store.generation}" in text
        for domain in store.domains.values():
            assert f"{domain.domain} ({domain.kind})" in text
        for run in tiny.RUNS:
            median = run_metrics.side_metrics(store, run, "real").median_error
            (line,) = (line for line in text.splitlines() if line.strip().startswith(run))
            assert f"real {median:.2f} m" in line
            assert f"<td>{median:.2f}</td>" in store._repr_html_()
    assert repr(store).startswith("<closed store")


def test_runs_without_results_are_not_computed(trained_store):
    with s2rstore.open(trained_store) as store:
        assert "vanilla  not computed" in repr(store)
        assert "not computed" in store._repr_html_()


def test_html_escapes_names(tiny_store, monkeypatch):
    summary = interactive_store.RunSummary("<b>run</b>", None, None, 0, "not computed")
    monkeypatch.setattr(InteractiveStore, "_run_summaries", lambda self: [summary])
    with s2rstore.open(tiny_store) as store:
        assert "&lt;b&gt;run" in store._repr_html_()
        assert "<b>run" not in store._repr_html_()


@pytest.mark.usefixtures("declared_entry_points")
def test_figures_show_themselves_and_are_saved(tiny_store, tmp_path):
    with s2rstore.open(tiny_store) as store:
        figure = store.figure("map", run="dataaug", select="worst15", width=80, dpi=100)
        shown = Image.open(BytesIO(figure._repr_png_()))
        assert shown.width == round(80 / 25.4 * 100)
        for suffix, magic in ((".svg", b"<?xml"), (".pdf", b"%PDF")):
            figure.save(tmp_path / f"map{suffix}")
            assert (tmp_path / f"map{suffix}").read_bytes().startswith(magic)
        with pytest.raises(RequestError, match="must end in"):
            figure.save(tmp_path / "map.gif")


@pytest.mark.usefixtures("declared_entry_points")
@pytest.mark.parametrize(
    ("view", "options", "reason"),
    [
        ("plan", {}, "figure plan: must be one of overview"),
        ("map", {"colour": 1}, "unknown option colour"),
        ("map", {"cmap": "jet"}, "--cmap jet: must be one of turbo, viridis"),
        ("map", {"width": 5}, "--width 5: must be 40 to 420"),
        ("map", {"dpi": 10}, "--dpi 10: must be 72 to 1200"),
        ("map", {"width": 80, "size": (300, 200)}, "--size: pixels"),
    ],
)
def test_wrong_figure_options_are_refused_in_one_line(tiny_store, view, options, reason):
    with s2rstore.open(tiny_store) as store, refused(match=reason):
        store.figure(view, **options)


@pytest.mark.usefixtures("declared_entry_points")
def test_a_missing_package_is_named(tiny_store, monkeypatch):
    monkeypatch.setitem(sys.modules, "s2rtui.export.figures", None)
    with s2rstore.open(tiny_store) as store, pytest.raises(RequestError, match="install s2rtui"):
        store.figure("map")


def test_figures_need_an_installed_application(tiny_store, monkeypatch):
    monkeypatch.setattr(interactive_store, "FIGURES", "no.package.declares.this")
    reason = "figure: no installed package draws figures; install s2rtui"
    with s2rstore.open(tiny_store) as store, pytest.raises(RequestError, match=reason):
        store.figure("map")


@pytest.mark.parametrize("library", ["pandas", "polars", "arrow"])
def test_a_frame_table_holds_what_query_prints(tiny_store, library, s2r):
    pytest.importorskip({"arrow": "pyarrow"}.get(library, library))
    names = ["iid", "trajectory", "heading_deg", "real_error_m", "real_rank", "real_room"]
    asked = "worst15 | ids(3)", "--columns", "iid,traj,heading,real.error,real.rank,real.room"
    with s2rstore.open(tiny_store) as store:
        table = store.frame_table("vanilla", library, asked[0])
    lists = [table[name].to_pylist() if library == "arrow" else [*table[name]] for name in names]
    rows = s2r("query", tiny_store, *asked, "--json").json
    for values, row in zip(zip(*lists, strict=True), rows, strict=True):
        found = [None if value != value else value for value in values]  # pandas: NaN for None
        assert found == pytest.approx([*row.values()])


def test_a_missing_library_says_how_to_install_it(tiny_store, monkeypatch):
    monkeypatch.setitem(sys.modules, "polars", None)
    with s2rstore.open(tiny_store) as store:
        for library, message in (("polars", "pip install polars"), ("excel", "'excel'")):
            with refused(match=message):
                store.frame_table(library=library)

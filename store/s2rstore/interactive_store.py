"""A store for scripts and notebooks: SQL relations, a description of its content, figures."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any

import duckdb
import numpy as np

from s2rstore.errors import RequestError
from s2rstore.frame_table import Library, frame_table
from s2rstore.index import user_query
from s2rstore.language import Node
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rstore.security.printable_text import printable

FIGURES = "s2r.figures"
"""Group of the entry point of a package that draws figures: `figure(store, view, **options)`.

The application declares it, so that this package depends on no user interface.
"""


@dataclass(frozen=True, slots=True)
class RunSummary:
    """A line of the description: median errors in metres per side, or why there are none.

    sim, real: medians over `n` instances that are new to the run; None without results.
    """

    run: str
    sim: float | None
    real: float | None
    n: int
    note: str


class InteractiveStore(Store):
    """What `s2rstore.open` returns: a `Store` that answers SQL, describes itself and draws."""

    def sql(self, query: str) -> duckdb.DuckDBPyRelation:
        """The rows of a SELECT as a relation of DuckDB, read when they are used.

        `.df()`, `.pl()` and `.arrow()` of the relation give pandas, polars and Arrow tables; these
        packages must be installed. As `s2r sql`, the query runs on a read-only connection with
        locked settings that opens no other file, so that names of Python variables are no tables
        and the relation writes no file. The store must stay open while rows are read. Raises
        RequestError where the query fails or only statements without rows are given.
        """
        return user_query.relation(self.connection(), query)

    def frame_table(
        self,
        run: str | None = None,
        library: Library = "pandas",
        select: str | Node = "all",
        with_trained: bool = False,
    ) -> Any:
        """The fields of the selected instances of a run, by default the first, as a table.

        It is a DataFrame of pandas or polars, or a table of Arrow (`arrow`). Columns have the names
        and units that `s2r query` prints, such as `real_error_m` and `heading_deg`. Instances that
        the model was trained on are left out unless `with_trained`. Raises RequestError for unknown
        names, and where the package of the library is not installed.
        """
        return frame_table(self, run, library, select, with_trained)

    def figure(self, view: str, **options: Any) -> Any:
        """The figure of a view, such as `map`, as `s2r export` draws it.

        The object shows itself in Jupyter, and `save(path)` writes PNG, SVG or PDF. `options` are
        those of `s2r export` with underscores: `run`, `select`, `heat`, `title`, `width`, `cmap`
        and so on. The figure shows this generation of the store. Raises RequestError for unknown
        views and options, and where s2rtui or matplotlib is not installed.
        """
        return _figure_function()(self, view, **options)

    def __repr__(self) -> str:
        if self._opened is None:
            return f"<closed store {self.path}>"
        lines = [f"store {printable(self.path.name)}"]
        lines += [f"  {name}: {text}" for name, text in self._facts()]
        runs = self._run_summaries()
        if not runs:
            return "\n".join([*lines, "  runs: none"])
        lines.append("  runs, with median errors over the instances that are new to the model:")
        width = max(len(run.run) for run in runs)
        lines += [f"    {run.run:{width}}  {_run_text(run)}" for run in runs]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """The description as HTML, for notebooks."""
        if self._opened is None:
            return html.escape(repr(self))
        facts = "".join(_html_row("td", name, text) for name, text in self._facts())
        runs = "".join(
            _html_row("td", run.run, _metres(run.sim), _metres(run.real), run.n or "", run.note)
            for run in self._run_summaries()
        )
        head = _html_row("th", "run", "median sim (m)", "median real (m)", "n", "")
        name = html.escape(printable(self.path.name))
        return (
            f"<p><b>store {name}</b></p><table>{facts}</table><table>{head}{runs}</table>"
            "<p>Medians are over the n instances that are new to the run's model.</p>"
        )

    def _facts(self) -> list[tuple[str, str]]:
        """Names and values: data set, instances, trajectories, domains, generation."""
        names = ", ".join(trajectory.trajectory for trajectory in self.trajectories)
        domains = ", ".join(f"{domain.domain} ({domain.kind})" for domain in self.domains.values())
        facts = [
            ("data set", f"{self.dataset.name} ({self.dataset.hash[:12]})"),
            ("instances", str(len(self.instances))),
            ("trajectories", f"{len(self.trajectories)} ({names})"),
            ("domains", domains),
            ("generation", str(self.generation)),
        ]
        return [(name, printable(text)) for name, text in facts]

    def _run_summaries(self) -> list[RunSummary]:
        return [_summary(self, name) for name in self.runs]


def _figure_function() -> Callable[..., Any]:
    """The function that an installed package declares in group `FIGURES`."""
    declared = next(iter(entry_points(group=FIGURES)), None)
    if declared is None:
        raise RequestError("figure: no installed package draws figures; install s2rtui")
    try:
        function: Callable[..., Any] = declared.load()
    except ImportError as error:
        message = f"figure: needs the package {error.name}; install s2rtui"
        raise RequestError(message) from error
    return function


def _summary(store: Store, name: str) -> RunSummary:
    """Medians of a run; a run that cannot be read says so instead of raising an error."""
    shown = printable(name)
    try:
        if store.run(name).key is None:
            return RunSummary(shown, None, None, 0, "not computed")
        columns, new = store.run_columns(name), run_metrics.population(store, name)
        count = int(new.sum())
        trained = int(columns.valid.sum()) - count
        notes = [store.coverage(name).summary, f"{trained} trained left out" if trained else ""]
        if not count:
            return RunSummary(shown, None, None, 0, "trained on every instance")
        sim, real = (float(np.median(columns.side(side).error[new])) for side in SIDES)
    except RequestError as error:
        return RunSummary(shown, None, None, 0, f"cannot be read: {printable(str(error))}")
    return RunSummary(shown, sim, real, count, ", ".join(note for note in notes if note))


def _run_text(run: RunSummary) -> str:
    if run.sim is None or run.real is None:
        return run.note
    text = f"sim {_metres(run.sim)} m, real {_metres(run.real)} m, n {run.n}"
    return f"{text} ({run.note})" if run.note else text


def _metres(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _html_row(tag: str, *cells: object) -> str:
    texts = "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells)
    return f"<tr>{texts}</tr>"

"""Commands of s2rtools that need parts of the application: `s2r collect`, `suggest`, `translate`.

`collect` saves its selection in the user's notebook, `suggest` draws a figure of its answers, and
`translate list` prints the translators of a store.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import s2rstore
from s2rstore.reader import Store
from s2rstore.records import Run
from s2rstore.suggestions import AIMS, SuggestReport
from s2rtools.common.command_line import output, store_argument
from s2rtools.common.result_files import check_writable
from s2rtools.data_collection import command as collecting
from s2rtools.suggestions import command as suggesting
from s2rtools.translator_evaluation import command as translating
from s2rtui.cli.command_parser import Command

if TYPE_CHECKING:
    from s2rtools.data_collection.plan import CollectionPlan

_FIGURE_SIZE = (1400, 1000)


def _collect(options: argparse.Namespace) -> int:
    from s2rtui.user_data.notebook_schema import valid_name

    if options.save is not None:
        valid_name(options.save, "name")
    return collecting.execute(options, _save_selection)


def _save_selection(store: Store, plan: CollectionPlan, name: str) -> None:
    """Save the expression in the user's notebook. Raises RequestError for an invalid name."""
    from s2rtui.user_data.notebook import Notebook
    from s2rtui.user_data.notebook_schema import SavedSelection

    notebook = Notebook(store.identity, parts=store.parts)
    count = len(set(plan.nearest.tolist()))
    notebook.save(name, SavedSelection(plan.expression, store.generation, plan.request.run, count))


def _suggest(options: argparse.Namespace) -> int:
    if options.figure is not None:
        _check_figure(options.figure)
    return suggesting.execute(options, _write_figure)


def _check_figure(path: Path) -> None:
    """Raise RequestError for a file of another format or in a folder that does not exist."""
    from s2rtui.export.figures import format_of

    format_of(path, "--figure")
    check_writable({"--figure": path})


def _write_figure(report: SuggestReport, run: Run, options: argparse.Namespace) -> None:
    from s2rtui.canvas import LIGHT
    from s2rtui.charts.suggestions import Direction, paper_drawing
    from s2rtui.drawing.figure_format import FigureFormat, figure_format
    from s2rtui.drawing.paper import draw_paper
    from s2rtui.export.figures import format_of

    store = str(options.store)
    commands = tuple(answer.command(store, run, report.side) for answer in report.answers)
    direction = Direction(report.side, AIMS[report.side], report, commands)
    with figure_format(FigureFormat(format_of(options.figure, "--figure"))):
        title = f"{report.run}: what would help"
        data = draw_paper(paper_drawing((direction,)), _FIGURE_SIZE, LIGHT, title)
    output.write_file(options.figure, data)


def _add_translate_arguments(parser: argparse.ArgumentParser) -> None:
    actions = translating.add_actions(parser)
    listed = actions.add_parser("list", help="list the translators of a store")
    listed.add_argument("--store", type=store_argument.folder, required=True, help="store folder")
    output.add_output_options(listed)
    listed.set_defaults(action=_list_translators)


def _translate(options: argparse.Namespace) -> int:
    options.action(options)
    return 0


def _list_translators(options: argparse.Namespace) -> None:
    from s2rtui.charts.overview import translator_rows

    with s2rstore.open(options.store) as store:
        found = {row.translator: row for row in translator_rows(store)}
        rows = [
            (name, record.method, record.source_domain, record.target_domain, found[name].verdict,
             "; ".join(gain.text for gain in found[name].gains), "; ".join(record.reasons))
            for name, record in store.translators.items() if name in found
        ]  # fmt: skip
    names = ("translator", "method", "from", "to", "verdict", "gain", "reasons")
    output.write(names, rows, options)


COMMANDS = {
    "collect": Command(collecting.EXAMPLE, collecting.add_arguments, _collect),
    "suggest": Command(suggesting.EXAMPLE, suggesting.add_arguments, _suggest),
    "translate": Command(translating.EXAMPLE, _add_translate_arguments, _translate),
}

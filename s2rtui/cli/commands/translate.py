"""`s2r translate`: the actions of the tools, and the list of a store's translators."""

from __future__ import annotations

import argparse

import s2rstore
from s2rtools.common.command_line import output, store_argument
from s2rtools.translator_evaluation import command

EXAMPLE = command.EXAMPLE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = command.add_actions(parser)
    listed = actions.add_parser("list", help="list the translators of a store")
    listed.add_argument("--store", type=store_argument.folder, required=True, help="store folder")
    output.add_output_options(listed)
    listed.set_defaults(action=_list)


def execute(options: argparse.Namespace) -> int:
    options.action(options)
    return 0


def _list(options: argparse.Namespace) -> None:
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

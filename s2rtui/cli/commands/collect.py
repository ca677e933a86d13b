"""`s2r collect`: the plan of the tools, and its selection in the user's notebook."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from s2rstore.reader import Store
from s2rtools.data_collection import command

if TYPE_CHECKING:
    from s2rtools.data_collection.plan import CollectionPlan

EXAMPLE = command.EXAMPLE
add_arguments = command.add_arguments


def execute(options: argparse.Namespace) -> int:
    from s2rtui.user_data.notebook_schema import valid_name

    if options.save is not None:
        valid_name(options.save, "name")
    return command.execute(options, _save)


def _save(store: Store, plan: CollectionPlan, name: str) -> None:
    """Save the expression in the user's notebook. Raises RequestError for an invalid name."""
    from s2rtui.user_data.notebook import Notebook
    from s2rtui.user_data.notebook_schema import SavedSelection

    notebook = Notebook(store.identity, parts=store.parts)
    count = len(set(plan.nearest.tolist()))
    notebook.save(name, SavedSelection(plan.expression, store.generation, plan.request.run, count))

"""Fields of the selected instances as a table of pandas, polars or Arrow."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, missing_package
from s2rstore.language import Node, evaluation, fields
from s2rstore.language.numpy_backend import MaskContext, field_values
from s2rstore.language.syntax_tree import Field
from s2rstore.reader import Store
from s2rstore.records import NO_RUN

Library = Literal["pandas", "polars", "arrow"]
_MODULES: dict[Library, str] = {"pandas": "pandas", "polars": "polars", "arrow": "pyarrow"}
_WHOLE = ("iid",)


def frame_table(
    store: Store,
    run: str | None,
    library: Library,
    select: str | Node,
    with_trained: bool,
) -> Any:
    """See `InteractiveStore.frame_table`."""
    if library not in get_args(Library):
        raise RequestError(f"library {library!r}: one of {', '.join(get_args(Library))}")
    try:
        module = import_module(_MODULES[library])
    except ModuleNotFoundError as error:
        if error.name != _MODULES[library]:
            raise
        raise missing_package(_MODULES[library]) from None
    name = NO_RUN if run is None and store.missing_run else store.run_name(run)
    query = evaluation.query(store, select, name, with_trained=with_trained)
    evaluation.require_predictions(store, query)
    columns = _columns(query.context, np.flatnonzero(query.instances))
    return module.table(columns) if library == "arrow" else module.DataFrame(columns)


def _columns(context: MaskContext, iids: NDArray[np.intp]) -> dict[str, Any]:
    """Values (n,) by the names of columns that `s2r query` prints; NaN and None are missing."""
    columns: dict[str, Any] = {}
    for name, numeric in fields.NUMERIC.items():
        if context.run != NO_RUN or fields.is_truth(name):
            values = field_values(Field(name), context)[iids] / numeric.scale
            columns[fields.column_of(name)] = iids.copy() if name in _WHOLE else values
    for name, text in fields.TEXT.items():
        if text.path == "split" or text.column:
            if context.run == NO_RUN and not fields.is_truth(name):
                continue
            codes = fields.column(text.path, context.instances, context.run_columns(context.run))
            columns[text.column or name] = _names(codes[iids], context.words.of(text.vocabulary))
    return columns


def _names(codes: NDArray[Any], names: Sequence[str]) -> list[str | None]:
    return [names[code] if code >= 0 else None for code in codes.tolist()]

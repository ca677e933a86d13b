"""Rows of the selected instances with all fields of the language, tags and notes, as CSV."""

from __future__ import annotations

from pathlib import Path

from s2rstore.language import fields
from s2rstore.records import NO_RUN
from s2rtools.common.command_line.row_formats import csv_text
from s2rtui.export.other_programs.content import ExportContent
from s2rtui.export.rows import NOTEBOOK_COLUMNS, selected_rows


def write(content: ExportContent, path: Path) -> None:
    """Write the rows; columns of predictions are left out without a run."""
    names = [
        fields.with_unit(name) for name in (*fields.NUMERIC, *fields.TEXT)
        if content.run != NO_RUN or fields.is_truth(name)
    ]  # fmt: skip
    found = selected_rows(content.store, content.query, content.notes, [*names, *NOTEBOOK_COLUMNS])
    text = csv_text(found.names, found.rows, safe=content.safe_csv)
    path.write_text(text, encoding="utf-8", errors="backslashreplace")

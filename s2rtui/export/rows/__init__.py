"""Rows for other programs: formats, and the instances of a selection with what it was true of."""

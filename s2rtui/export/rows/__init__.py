"""Export of rows: file formats, and the instances of a selection with their metadata."""

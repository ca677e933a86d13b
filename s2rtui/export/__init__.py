"""Export to files: figures, reports, rows, screenshots."""

"""Report of selections: one self-contained HTML file for a browser or a printer."""

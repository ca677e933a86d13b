"""Text output of the commands: tables, progress, gap reports."""

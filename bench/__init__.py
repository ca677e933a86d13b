"""Measurements against the budgets: `python -m bench --json`, one line per figure.

Each speed has a reference row: the same work by a plain implementation, measured in the same run.
"""

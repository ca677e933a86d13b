"""Measurements against the budgets: `python -m bench --json`, one line per figure.

Every speed stands beside the same work done the plain way in the same run, as a reference row.
"""

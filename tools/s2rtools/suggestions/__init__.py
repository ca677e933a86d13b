"""Suggested changes of real images or of the simulator: search, judgement on held-out data, report.

`suggest.suggest` is the entry point; `s2r suggest` prints what it returns.
"""

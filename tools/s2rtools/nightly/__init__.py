"""Nightly gate: measure the gap, record it in a history, publish reports."""

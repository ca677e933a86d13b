"""The gate: reference, golden run, verdict."""

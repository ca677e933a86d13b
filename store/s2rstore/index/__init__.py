"""The DuckDB index of a store."""

"""Zarr arrays of a store."""

"""The precompute tools."""

"""Verifying and pruning a store."""

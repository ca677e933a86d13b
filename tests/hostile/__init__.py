"""Hostile and damaged stores, files, names and terminals."""

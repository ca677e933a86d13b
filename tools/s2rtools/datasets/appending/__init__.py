"""Append the new instances and domains of a scan to a store."""

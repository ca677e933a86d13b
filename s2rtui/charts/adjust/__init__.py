"""The adjust view."""

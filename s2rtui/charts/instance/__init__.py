"""The instance view."""

"""The findings view."""

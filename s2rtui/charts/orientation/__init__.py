"""The orientation view."""

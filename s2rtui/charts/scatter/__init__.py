"""The scatter view."""

"""The errors view."""

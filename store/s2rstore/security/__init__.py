"""Limits and text sanitizing for untrusted input."""

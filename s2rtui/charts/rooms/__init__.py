"""The rooms view."""

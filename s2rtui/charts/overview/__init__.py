"""The overview view."""

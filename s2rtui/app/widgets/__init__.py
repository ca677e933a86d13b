"""Widgets that draw ready canvases and load nothing."""

"""The default world: a furnished building that is rendered, with a real side whose gap is known."""

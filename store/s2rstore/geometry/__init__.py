"""Geometry of cameras, rooms and the floor, in numpy alone."""

"""Frames that a renderer program renders at requested poses, in a folder that ingest reads."""

"""Pose metrics, run metrics, and summaries of a store."""

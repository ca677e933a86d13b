"""Fit translators on the frames of a store and judge them: distance, content, task, cost."""

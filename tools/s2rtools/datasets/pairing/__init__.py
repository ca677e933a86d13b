"""Pairs of two recordings: matching, and the data set that they make."""

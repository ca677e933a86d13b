"""Tests of suggested changes."""

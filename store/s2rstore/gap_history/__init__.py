"""The history of nightly gap measurements."""

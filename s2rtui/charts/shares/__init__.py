"""The shares view: how many metres of the gap each factor causes."""

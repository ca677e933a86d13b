"""Time delay between two motion logs, and the delay axis."""

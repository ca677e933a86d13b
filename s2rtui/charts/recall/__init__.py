"""The recall view: shares of instances within thresholds of position and heading."""

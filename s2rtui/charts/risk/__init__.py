"""The risk table: calibration of sigma, mean errors by certainty, and conformal radii."""

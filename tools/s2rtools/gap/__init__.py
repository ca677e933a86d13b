"""The reality gap, measured axis by axis with its uncertainty."""

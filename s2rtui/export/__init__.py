"""Files made from a state: reports, rows, screenshots."""

"""Tables in text files of unknown origin: lines, rows of numbers, and CSV with column names."""

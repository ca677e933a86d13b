"""The gap of every night: measured once per evidence, kept in a history, told in files."""

"""Background threads and subprocesses."""

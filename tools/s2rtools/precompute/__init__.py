"""Compute registered runs in restartable work units and publish their arrays and index rows."""

"""From registered runs to published arrays and index rows, in work units that survive kill -9."""

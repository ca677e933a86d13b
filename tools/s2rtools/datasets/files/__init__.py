"""Files of unknown origin: lines, tables and images, read within limits and checked."""

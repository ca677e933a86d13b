"""Tasks of a run, one module each: what declares its stages, and the function that they carry.

To add a task, write one module, and add its stages to `run_stages`.
"""

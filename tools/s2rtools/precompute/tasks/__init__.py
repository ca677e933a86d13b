"""Tasks of a run, one module each: a function that declares its stages and one that computes them.

To add a task, write one module, add its stages to `pipeline._compute_run` and its function to
`unit_computer.UnitComputer`.
"""

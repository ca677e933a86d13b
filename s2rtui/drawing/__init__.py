"""Drawings of statistical views: what is drawn as plain data, and renderers that know no view.

`plot` and `scale` describe a drawing: marks on two axes, a table, notes. `cells` draws it in
character cells, `paper` with matplotlib (imported when the first figure is drawn).
"""

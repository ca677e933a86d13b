"""The views: each folder holds one, in at most four modules of its own.

`view.py` holds a subclass of `s2rtui.charts.view.View` and its only instance, `VIEW`: name, key,
texts, brushes and clicks. `model.py` turns columns of a store into the numbers that are drawn and
defines the view's input, plain arrays. `terminal.py` draws them in cells, `paper.py` with
matplotlib (imported inside functions, so that the application starts without it). Larger views
have further modules (`overview/lines.py`, `orientation/dial.py`).

To add a view, write such a folder and add its name to `s2rtui/charts/registry.py`. Keys, help,
`s2r show` and `s2r export` follow from the registry. The table of `risk` has no drawing: `s2r show`
alone prints it. A view that needs data which takes time to
read names a loader of `s2rtui.loaders` in `loads`.

`shared` holds what several views use: maps, images of an instance, legends, scales, the page of
a figure. No view imports another one.
"""

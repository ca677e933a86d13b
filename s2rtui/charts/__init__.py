"""The views: each is a module or a folder.

A statistical view is one module with a `DrawingView` as `VIEW`, such as `recall.py`: it says what
is drawn, and `s2rtui.drawing` draws it. Maps, images and views with brushes are folders: `view.py`
holds a subclass of `s2rtui.charts.view.View` and its only instance, `VIEW`: name, key, texts,
brushes and clicks. `model.py` turns columns of a store into the numbers that are drawn and defines
the view's input, plain arrays. `terminal.py` draws them in cells, `paper.py` with matplotlib
(imported inside functions, so that the application starts without it).

To add a view, write such a module or folder and add its name to `s2rtui/charts/registry.py`. Keys,
help, `s2r show` and `s2r export` follow from the registry. A view that needs data which takes time
to read names a loader of `s2rtui.loaders` in `loads`.

`shared` holds what several views use: maps, images of an instance, legends, scales, the page of
a figure. No view imports another one.
"""

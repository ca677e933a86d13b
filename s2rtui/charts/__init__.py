"""The views: each is a module, or a folder whose module `view` has the view.

A view is a subclass of `s2rtui.charts.view.View` and its only instance, `VIEW`. It makes numbers of
the columns of a store, and says by plots, a table and notes what is drawn of them. `s2rtui.drawing`
draws these in cells, in true pixels and on pages, and knows no view.

To add a view, write such a module and add its name to `s2rtui/charts/registry.py`. Keys, help,
`s2r show` and `s2r export` follow from the registry. A view whose data takes time to read names a
loader of `s2rtui.loaders` in `loads`.

`shared` holds what several views use: inputs of an instance and layers of maps. No view imports
another one.
"""

"""Data sets: read paired images with poses, or images without, and write them as a store.

`importers.IMPORTERS` maps the name of a whole data set's layout to a function
`scan(path, options) -> Scan`. `layouts.LAYOUTS` does so for recordings, which are one side of a
data set: `layouts.read(layout, path)` returns a `Recording`.
"""

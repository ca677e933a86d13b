"""Translators: fitted maps that make images of one domain look like those of another.

Registry: `METHODS` maps a method's name to a `TranslationMethod`. To add a method, write one module
here that defines a `TranslationMethod`, and add one line to `OWN`. A package outside of this
project adds one by an entry point of the group `s2r.translators` whose name is that of the method.
Methods are imported when they are used, because the learned ones need torch.
"""

from __future__ import annotations

from s2rstore.plugins import Registry, instance_of
from s2rtools.translation.method import TranslationMethod

__all__ = ["METHODS", "TranslationMethod"]

OWN = (
    ("identity", "colour_maps:IDENTITY"),
    ("grayworld", "colour_maps:GRAYWORLD"),
    ("levels", "colour_maps:LEVELS"),
    ("reinhard", "colour_maps:REINHARD"),
    ("mkl", "colour_maps:MKL"),
    ("histogram", "colour_maps:HISTOGRAM"),
    ("fda", "fda:METHOD"),
    ("style", "style:METHOD"),
    ("style-network", "style_network:METHOD"),
    ("cut", "cut:METHOD"),
    ("cyclegan", "cyclegan:METHOD"),
    ("unit", "unit:METHOD"),
    ("mkl+residual", "residual:METHOD"),
)
"""Names of the methods, in the order in which they are listed, and where they are defined."""


METHODS = Registry[TranslationMethod](
    "translator",
    {name: f"s2rtools.translation.{where}" for name, where in OWN},
    instance_of(TranslationMethod),
)

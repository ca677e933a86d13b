"""The synthetic world: a furnished building, rendered on two sides with a known gap between them.

Registries: `factors.FACTORS` lists the reasons why the real side differs; `furniture.FURNITURE`
lists the pieces of furniture.
"""

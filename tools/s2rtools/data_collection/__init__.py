"""Where to take new real images: poses at which the expected reduction of real error is largest."""

from s2rtools.data_collection.expected_reduction import METHODS, Method
from s2rtools.data_collection.plan import CollectionPlan, CollectionRequest, plan_collection

__all__ = ["METHODS", "CollectionPlan", "CollectionRequest", "Method", "plan_collection"]

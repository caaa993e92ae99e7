"""What the paper does not have; each idea is a module that adds itself from outside.

Importing the package makes its recipes, its scenario, its planner and its random cities known by
name.
"""

from uavdh_lite.beyond import cities, genie, recipes

__all__ = ["cities", "genie", "recipes"]

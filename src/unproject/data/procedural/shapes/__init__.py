"""Procedural data sets of shapes: chairs, birds, cars."""

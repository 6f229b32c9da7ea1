"""Procedural data sets: shapes, materials and light made from formulas."""

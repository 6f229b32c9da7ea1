"""Procedural data sets of surface materials: wood, metal, plastic, fabric, correlated."""

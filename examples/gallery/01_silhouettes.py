"""
Silhouettes
===========

Three procedural chairs, each from eight azimuths, a row a chair: what ``unproject train shapes`` learns from. A level
silhouette from azimuth a and one from a + 180° are mirror images of one another.
"""

import math

import torch

import unproject as up

chairs = up.data.chairs(3, resolution=64, seed=2)
azimuth = torch.arange(8) * math.pi / 4
views = up.Silhouette()(chairs.repeat_interleave(8, 0), azimuth=azimuth.repeat(3), elevation=torch.zeros(24))
up.export.silhouette_sheet(views, "runs/silhouettes.png", columns=8)

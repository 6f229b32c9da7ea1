"""
What level silhouettes can tell
===============================

A bowl-shaped seat looks full from all level sides. The generators of ``shapes`` return the *visual hull*: the largest
volume with the same level silhouettes. Left a box with a hollow top, right its hull.
"""

import torch

import unproject as up

box = torch.zeros(1, 32, 32, 32)
box[:, 6:26, 8:22, 6:26] = 1
box[:, 10:22, 13:22, 10:22] = 0
hull = up.ops.visual_hull(box)
up.export.gallery(torch.cat([box, hull]), "runs/hull.png", elevation=0.7, columns=2)

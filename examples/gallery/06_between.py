"""
From one shape to another
=========================

Two samples of the example run, left and right, and five shapes between them, along a straight line between their codes.
"""

import torch

import unproject as up

run = up.from_pretrained("chairs")
first, last = run.generator.codes(16, seed=4)[[12, 11]]
codes = torch.stack([torch.lerp(first, last, part) for part in torch.linspace(0, 1, 7)])
up.export.gallery(up.ops.largest_part(run.generator(codes)), "runs/between.png", azimuth=3.6, size=128, columns=7)

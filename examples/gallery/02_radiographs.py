"""
Radiographs: an operator of your own
====================================

The light that a volume lets through, as a detector behind it would measure X-rays: a forward operator of four lines,
with which `the tutorial <../tutorials/operator.html>`_ trains.
"""

import math

import torch

import unproject as up


class Radiograph(up.Projection):
    """The share of a beam that reaches a detector behind a volume turned by `azimuth` (radians) about the up axis."""

    def forward(self, x, *, azimuth):
        thickness = up.ops.rotate_y(x, azimuth).mean(3)  # (B, X, Y)
        return (-3 * thickness).exp().transpose(1, 2).flip(1)[:, None]  # (B, 1, rows from the top, columns)


chairs = up.data.chairs(3, resolution=64, seed=2)
azimuth = torch.arange(6) * math.pi / 6
views = Radiograph()(chairs.repeat_interleave(6, 0), azimuth=azimuth.repeat(3))
up.export.picture_sheet(views, "runs/radiographs.png", columns=6, cell=132)

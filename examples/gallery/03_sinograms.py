"""
Line integrals of digits
========================

Each digit above its sinogram: a column is one line of 32 detectors, at angles from 0 to 180°.
``unproject train digits`` learns images from single columns.
"""

import math

import torch

import unproject as up

digits = up.data.digits(32)[:8]
angle = torch.arange(32) * math.pi / 32
lines = up.LineIntegral()(digits.repeat_interleave(32, 0), angle=angle.repeat(8))
sinograms = lines.view(8, 1, 32, 32).transpose(2, 3)
up.export.picture_sheet(torch.cat([digits, sinograms / sinograms.amax()]), "runs/sinograms.png", columns=8)

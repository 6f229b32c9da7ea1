"""
The shape behind a silhouette
=============================

One silhouette of a chair that the example run has never seen, at an azimuth that is not told, with the best shape's
silhouette; then the chair itself and two shapes whose silhouettes come near it. Views are known up to a mirror image
only (`conventions <../conventions.html>`_). ``unproject fit`` does this for files.
"""

import torch

import unproject as up
from unproject.inversion import Fitter, Search, Viewing

chair = up.data.chairs(8, seed=11)[5:6]
silhouette = up.Silhouette(size=32)(chair, azimuth=torch.tensor([0.6]), elevation=torch.zeros(1))
views = up.projections.azimuth_bins(16, up.Silhouette(size=32, rule="absorption", density=2.0))
generator = up.from_pretrained("chairs").generator
found = Fitter(generator, Viewing.of(views), Search(candidates=128, starts=2, steps=30, tune=0)).fit(silhouette)
print(f"distance {found.error:.2f}, azimuth {found.theta['azimuth'][0].item():.2f} of 0.60 rad, up to the gauge")
up.export.silhouette_sheet(torch.cat([silhouette, found.projected]), "runs/fit-1-silhouettes.png", scale=4)
up.export.contact_sheet(torch.cat([chair, found.x]), "runs/fit-2-shapes.png", names=["true", "1st", "2nd"])

"""Errata of the paper's supplemental material, and values that it leaves open."""

from __future__ import annotations

ERRATA = (
    "Eq. 5 leaves out L(ωi). The derivative by k_s is an integral over the light, like that by k_d (eq. 4), and is "
    "computed so here.",
    "650 samples of four maps are said to be as many training images as 4 × 500 + 2 × 250 = 2,500; they are 2,600. "
    "Here 625 samples are taken, 625 × 4 = 2,500.",
    "Section 2.5 announces two data sets, wood and metal; it shows three, with plastic.",
    'Grazing views are 80° ± 5° "from the up direction" and the top view is 0°, so the angles are taken from the '
    "normal and are not elevations.",
    "The text lists Figs. 2, 3 and 4 as bird, chair and car; by their captions they are chair, bird and car, and are "
    "here.",
)
"""Errors, each with the reading taken here."""

LEFT_OPEN = (
    "Part I gives no loss, optimiser, batch, code length or schedule. The released code's are taken: WGAN-GP with λ = "
    "10 on top of spectral normalisation, Adam at 1e-4 with β = (0.5, 0.999), two discriminator updates a generator "
    "update, codes of 256 numbers, five rounds of 60,000 generator steps, in each but the first a new view predictor "
    "trained by Adam at 1e-3 with batches of 32. The batch is 32 (the released code's: 12 at 64³).",
    'The 16 "discrete view-bins" have no angles: 16 bins of azimuth at elevation 0, 22.5° each, as in the released '
    "code. The camera is orthographic and sees the object's box; the silhouette of a ray is 1 - Π(1 - p) of samples "
    "one voxel apart.",
    'How many of the "first convolutional layers" discriminators share: two of four here, and the rest and the last '
    "layer once a view-bin.",
    "η of the Fresnel term is never given: 1.5 where eq. 2 is taken literally, a parameter. G is named shadowing and "
    "masking without a formula: Smith's for Beckmann's distribution.",
    "The materials' GAN has no loss, batch, number of steps or of channels in the text: the logistic loss without "
    "penalty of DCGAN, 64 materials, 50,000 steps, 512 channels at 4² in the generator and 64 after the first layer of "
    "a discriminator. Batch norm of a discriminator takes the statistics of real and of generated images apart.",
    "The number of samples a pixel and the camera's distance: 32 (8 in the cpu budget), and four widths of the "
    "material.",
    "Part III names no network, loss or schedule, and not which ten directions: networks and losses follow Part I "
    "(see the deviations), directions are evenly spaced over half a turn.",
)
"""Values that are not given, with those taken here."""

"""What differs from the paper everywhere, and what the paper itself has wrong or leaves open."""

from __future__ import annotations

DEVIATIONS = (
    "Each figure has arms of two kinds. Those whose names end in -paper keep the paper's networks, losses and rates "
    "as far as it gives them; the others are this project's recipes (relativistic loss with R1 + R2, averaged "
    "weights, generators of their own), which are what a laptop can train in minutes.",
    "In the cpu budget an arm has one core of two for nine minutes, or for 1,400 steps of this project's materials "
    "(the tables say how long these took), so the paper's recipes are narrower there (see each command below), far "
    "from converged, and say only what can be had in that time. The gpu budget has the paper's sizes; where this "
    "page shows none of its results, no GPU could be had.",
    "The view predictor of the paper's recipe is trained for 200 steps a round with 2,048 silhouettes in "
    "the cpu budget; the released code takes 100,000 and 65,536.",
    "The paper judges by eye. Here every claim is a number, and an effect that is no larger than what seeds differ by "
    "leaves it undecided.",
    "Wood verified by artists, SVBRDFs of metal and plastic, 98 light probes and the photographs are not "
    "public in that form: procedural worlds and probes stand in for them, and real texture sets (9 of wood, "
    "22 of metal, 5 of plastic) and 45 real probes where --data is given.",
    "Arms of real photographs, of car meshes and of real texture sets are scored against the collection they learn "
    "from, since there are too few to hold some out: read their scores as how near, not how new.",
    'k_s is read as the reflectance at normal incidence (`fresnel="albedo"`): with the paper\'s F0 of (η - '
    "1)²/(η + 1)² and η = 1.5 a k_s of 1 reflects four per cent, which no metal does.",
    'Gradients of rendering are exact, not finite differences (which `Sampling(gradient="differences")` '
    "computes): in spherical coordinates those are degenerate where a normal is flat.",
)
"""From the paper, in every figure, each with its reason; a figure has its own besides."""

SLIPS = (
    "Eq. 5 leaves out L(ωi): the derivative by k_s is an integral of light like that by k_d (eq. 4), and "
    "is taken so here.",
    "650 samples of four maps are said to be as many training images as 4 × 500 + 2 × 250 = 2,500; these "
    "are 2,600. Here 625 samples are taken, 625 × 4 = 2,500.",
    "η of the Fresnel term is never given: 1.5 here where eq. 2 is taken literally, a parameter.",
    "Section 2.5 announces two data sets, wood and metal; there are three, with plastic.",
    'Grazing views are 80° ± 5° "from the up direction", and 0° is the top, so angles are from the '
    "normal, not elevations.",
    "Neither the loss nor the batch of the materials' GAN is given, nor any network of Part III: DCGAN's "
    "and those of Part I, one dimension lower.",
    "The text lists Figs. 2, 3 and 4 as bird, chair and car; by their captions they are chair, bird and "
    "car, and are here.",
    'The view-bins are "16 discrete" ones without angles; the released code has 16 of azimuth at elevation 0.',
)
"""Of the paper, and what is done about each."""

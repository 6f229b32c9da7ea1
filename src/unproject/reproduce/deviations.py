"""Deviations from the paper that concern several figures, each with its reason."""

from __future__ import annotations

GENERAL = (
    "Each figure has two kinds of arms. Arms with a recipe NAME-paper keep the paper's networks, losses and rates as "
    "far as it gives them, with the deviations listed below. The others are this project's recipes (relativistic loss "
    "with R1 + R2, other generators), which train in minutes on a laptop.",
    "In the cpu budget an arm has nine minutes. The paper's recipes are narrower there (see each command below) and "
    "far from converged: they say only what they reach in that time. The gpu budget has the paper's sizes.",
    "The paper shows pictures only. Here every claim is tested on scores, and an effect within the variance between "
    "seeds is undecided.",
    "Wood verified by artists, SVBRDFs of metal and plastic, 98 light probes and the photographs are not public in "
    "that form. Procedural data sets and probes replace them, and with --data real texture sets (9 of wood, 22 of "
    "metal, 5 of plastic) and 45 real probes.",
    "Arms of real photographs, of car meshes and of real texture sets are scored against the collection that they are "
    "trained on, which is too small to hold a part out. Their scores measure distance, not novelty.",
)
"""Of all arms."""

PAPER_RECIPES = (
    "Averaged weights: scores, pictures and the view predictor's training images come from an exponential moving "
    "average of the generator's weights with a half-life of 300 steps (a tenth of the steps so far, early in "
    "training). The paper does not mention averaging. All arms of this page, those of the paper's recipes too, were "
    "trained with it, so that scores depend less on the last few steps; what it changes was not measured for these "
    "recipes. `--ema-half-life 0` turns it off.",
    "Divergence: a run whose numbers stop being finite, or whose images all look the same (five checks in a row their "
    "deviation is under 2 % of the real ones'), returns once to its last checkpoint with half the learning rate. The "
    "paper says nothing of diverged runs.",
)
"""Of all recipes NAME-paper."""

PAPER_SHAPES = (
    "Soft silhouettes: the paper's discriminators take binary images. Here rendered training silhouettes are soft, "
    "values in [0, 1], unless --binary is given: generated silhouettes are soft, as gradients need, and binary "
    "training images could be distinguished from them by the values of their edges alone. The view predictor gets both "
    "cut at one half.",
    "No probability: the paper's discriminator puts out a probability. Here it puts out a real number without a "
    "sigmoid, as the Wasserstein loss of the released code needs.",
    "The view predictor has 32 channels after its first convolution, as the released code has it, not the "
    'discriminator\'s 64 (16 in the cpu budget), as "the same convolutional structure" may be read. Its learning rate '
    "falls linearly to 0, since it is trained for few steps here.",
    "The view predictor is not trained jointly with the generator but anew in each of four rounds, as in the released "
    "code: 100,000 steps on 65,536 silhouettes of generated shapes, each shape seen from four views. In the cpu budget "
    "these are 200 steps and 2,048 silhouettes.",
    "Unlabelled silhouettes of embedded and 3-D collections are rendered from views drawn uniformly, 16 of each of "
    "1,000 shapes. Nothing tells which show the same shape, but the paper's photographs each show another one.",
)
"""Of shapes-paper."""

PAPER_MATERIALS = (
    "Standardised images: maps and renderings, real and generated, are brought to mean 0.5 and deviation 0.25 of the "
    "training images, channel by channel, before a discriminator sees them. A specular albedo varies by 0.01 around "
    "0.04, which a discriminator with images in [0, 1] hardly sees.",
    "Importance sampling of the light: three eighths of the samples of a pixel under natural light are drawn from the "
    "light, the others from the diffuse and the specular lobe in proportion to their albedos, as in the paper, and all "
    "are weighted by the balance heuristic. Points are low-discrepancy ones. Both reduce noise at 8 to 32 samples.",
    "Grazing views in texture space: each texel is shaded for the direction from which the camera sees it and stays at "
    "its place, while a camera's picture at 80° is a strip a sixth as high. Training pictures are rendered the same "
    'way, so no detail is lost to resampling. `Rendering(space="image")` renders the perspective picture.',
    "No batch norm after the first convolution of a discriminator, where the paper has it after each layer: DCGAN, "
    "whose architecture it follows, found training unstable with it. The norm stands before the activation.",
    "The generator ends in a 3² convolution of its own after the last doubling, before the sigmoid. Normals are 2σ - "
    "1 in x and y and σ + 0.05 in z, brought to unit length, so none points into the surface. Scale factors are a "
    "linear layer of the code and a softplus. 0.005 is added to the roughness.",
    'k_s is the reflectance at normal incidence (`fresnel="albedo"`), not a factor of the paper\'s F0 = (η - 1)²/(η + '
    "1)²: with η = 1.5 a k_s of 1 would reflect four per cent, which no metal does. The diffuse base gets only the "
    "light that is not reflected, k_d (1 - F), which eq. 2 leaves out, so that no surface reflects more light than it "
    "gets.",
    'Gradients of rendering are exact, not finite differences (which `Sampling(gradient="differences")` computes): in '
    "spherical coordinates differences are degenerate where a normal is flat.",
    "Gamma correction has a chord instead of the power below a radiance of 1e-4, where the power has an infinite "
    "derivative.",
    "Light without --probes: five procedural probes of 32 × 64 pixels, turned at random about the normal, for 98 "
    "measured ones.",
)
"""Of wood-paper, metal-paper and plastic-paper."""

PAPER_DIGITS = (
    "Discriminators and view predictor are those of Part I, one dimension lower, with the same loss, so the deviations "
    "of Part I apply: no probability, the predictor's 32 channels. The generator is DCGAN's (transposed convolutions "
    "from 512 channels at 4², a sigmoid, codes of 128 numbers), since Part I's convolutions and nearest upsampling are "
    "made for volumes.",
    "Steps of the view predictor were 20,000 in each round of `digits-paper` until a flag took their place "
    "(`--predictor-steps`, default: the released code's 100,000). The arm with predicted directions has 200 steps and "
    "2,048 lines in the cpu budget; no arm of this page was trained with 20,000.",
    "Line integrals are not binary and are seen by the predictor as they are.",
)
"""Of digits-paper."""

SECTIONS = {
    "All arms": GENERAL,
    "All of the paper's recipes": PAPER_RECIPES,
    "`shapes-paper`": PAPER_SHAPES,
    "`wood-paper`, `metal-paper`, `plastic-paper`": PAPER_MATERIALS,
    "`digits-paper`": PAPER_DIGITS,
}
"""Title → deviations."""

"""`unproject fit RUN PICTURES --out DIR`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from .._types import UserError
from ._formats import check_format
from ._threads import use_threads

if TYPE_CHECKING:
    from ..domains import Domain
    from ..inversion import Viewing
    from ..training import Run


def run(
    path: Path,
    pictures: tuple[Path, ...],
    /,
    *,
    out: Path = Path("fits"),
    view: str | None = None,
    light: str | None = None,
    observation: str | None = None,
    together: bool = False,
    scale: float | None = None,
    to: str | None = None,
    candidates: int = 256,
    starts: int = 8,
    steps: int = 100,
    rate: float = 0.1,
    prior: float = 0.02,
    view_searches: int = 5,
    tune: int = 30,
    consistent: bool = True,
    novelty: bool = True,
    seed: int = 0,
    threads: int | None = None,
    trust: bool = False,
) -> None:
    """Find the sample behind pictures: a shape by silhouettes, a material by photographs, an image by line integrals.

    OUT gets fit.npz (the arrays of `unproject sample`, one row an object), fit.json (views and their probabilities,
    distances, whether the pictures are explained), sheet.png (pictures, samples and their projections) and a folder of
    files an object, with several explanations, their mean and deviation in fit.npz. A run that was stopped goes on.

    Args:
        path: the run directory.
        pictures: masks, cut-outs or photographs; one folder of them, with views.csv if views are known; or one .npz of
            silhouettes or line integrals, with an array `azimuth` or `angle` if these are known.
        out: the folder to write.
        view: where the camera stood, degrees: azimuth and elevation of shapes (30,10), the angle from the normal and
            azimuth of materials (0,-90), the angle of lines (default: what views.csv or the .npz say, else unknown).
            A run that found its views itself knows no azimuth 0, unless its pictures had known ones beside them.
        light: of photographs of materials, as for `unproject render`; without --view from above.
        observation: which of the run's observations made the pictures (`top`, `flash`; default: its only ones).
        together: all pictures show one object (default: an object each; lines of one sinogram are of one image).
        scale: what readings of line integrals are divided by (default: what those of training were).
        to: the format of what is found (default: glb of shapes, maps of materials, png of images); see `export`.
        candidates: samples that are compared with the pictures first.
        starts: candidates that are optimised, and results returned.
        steps: of the optimisation.
        rate: Adam's learning rate, in standard deviations of latents.
        prior: weight of the Gaussian prior of latents.
        view_searches: how often views that are not known are searched anew during the optimisation.
        tune: steps that train the generator's own weights for these pictures alone, at the end.
        consistent: complete what is found so that it agrees with line integrals at known angles.
        novelty: compare pictures with those of training, which takes half a minute once a call (not with --light).
        seed: of the search.
        threads: processor threads (default: one a core that nobody else keeps busy).
        trust: import the run's code although it is not of this package.
    """
    from ..inversion import Search
    from ..training import load
    from ..training.given_pictures import PictureReader
    from ._fits import Job, write_fits

    if not pictures:
        raise UserError("fit: name pictures, a folder of them or an .npz")
    if light is not None and observation is not None:
        raise UserError(f"--observation {observation}: --light says how the photographs came about; give one of them")
    use_threads(threads)
    search = Search(candidates, min(starts, candidates), steps, rate, prior, view_searches, tune, consistent=consistent)
    opened = load(path, trust=trust)
    to = format_of(opened.domain, to)
    if light is None:
        reader = PictureReader.of(opened, observation, pictures)
    else:  # the light's own camera has the view
        reader, view = PictureReader(opened, lit_viewing(opened, view, light)), None
    found = reader.read(pictures, view, scale)
    fitter = opened.fitter(viewing=reader.viewing, search=search, seed=seed)
    write_fits(Job(found, fitter, reader.novelty() if novelty else None, opened, to, out), together)


def format_of(domain: Domain, to: str | None) -> str:
    """Return the format of what is found: the one that is given, or the domain's."""
    to = to or domain.written
    check_format(domain, to)
    return to


def lit_viewing(opened: Run, view: str | None, light: str) -> Viewing:
    """Return how photographs of a material come about under the light and from the view that are given."""
    from ..inversion import Viewing
    from ..ops.microfacet import Reflection
    from ..projections.observation import Observation
    from ..projections.priors import Product, Uniform
    from ..projections.rendering import Rendering
    from .render import light_of, view_of

    if opened.domain.name != "maps":
        raise UserError(f"--light {light}: only photographs of materials have a light; leave it out")
    theta, phi = view_of(view or "0")
    lighting, latents = light_of(light)
    rendering = Rendering(lighting, Reflection(getattr(opened.domain, "fresnel", "albedo")))
    fixed = {"view": math.radians(theta), "view_azimuth": math.radians(phi), **latents}
    drawn = [Uniform("jitter", 0, 1)] if "jitter" in rendering.latents else []
    prior = Product(*(Uniform(name, value, value) for name, value in fixed.items()), *drawn)
    return Viewing.of([Observation("given", rendering, prior)])

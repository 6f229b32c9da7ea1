"""`unproject sample RUN --n N --seed S --out F.npz`."""

from __future__ import annotations

from pathlib import Path

from .._types import UserError


def run(
    path: Path,
    /,
    *,
    n: int = 16,
    seed: int = 0,
    out: Path = Path("samples.npz"),
    size: int | None = None,
    largest_part: bool = False,
    trust: bool = False,
) -> None:
    """Draw samples from a run into an .npz file, float32.

    `volume` (N, X, Y, Z); or `image` (N, 1, H, W); or `diffuse`, `specular`, `roughness` and `normal` (N, C, H, W),
    linear, `specular` of one channel or of three, and `fresnel`, what the specular albedo means; or the arrays of a
    domain of your own.

    Args:
        path: the run directory.
        n: how many.
        seed: which; the same seed gives the same samples.
        out: the file to write.
        size: voxels a side of shapes, texels a side of materials: a multiple of what was trained (default: that). 128
            after 64 are shapes twice as fine; 1024 after 64 are materials that cover 16 times the side.
        largest_part: join near parts of shapes, and remove those that float.
        trust: import the generator's code although it is not of this package.
    """
    from .._files import naming
    from ..training import load
    from ._machine import warn_if_empty

    if n < 1:
        raise UserError(f"--n {n}: give at least 1")
    if out.suffix != ".npz":
        raise UserError(f"--out {out}: give a name that ends in .npz")
    opened = load(path, trust=trust)
    x = opened.sample(n, seed, largest_part=largest_part, size=size)
    with naming(out):
        opened.domain.write_arrays(x, out)
    warn_if_empty(opened.domain, x)
    print(f"{out}: {n} samples ({opened.domain.name}) of {'x'.join(map(str, x.shape[1:]))}")

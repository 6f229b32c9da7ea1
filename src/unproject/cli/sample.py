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
    trust: bool = False,
) -> None:
    """Draw new things from a run into an .npz file: `volume` (N, X, Y, Z) or `image` (N, 1, H, W), float32.

    Args:
        path: the run directory.
        n: how many.
        seed: which; the same seed gives the same things.
        out: the file to write.
        trust: import the generator's code although it is not of this package.
    """
    import numpy as np

    from .._files import atomic_path
    from ..training import load
    from ..training.run_directory import naming

    if n < 1:
        raise UserError(f"--n {n}: give at least 1")
    if out.suffix != ".npz":
        raise UserError(f"--out {out}: give a name that ends in .npz")
    x = load(path, trust).generator.sample(n, seed)
    volumetric = x.dim() == 4 and x.shape[1] > 4
    kind = "volume" if volumetric else "image"
    with naming(out), atomic_path(out) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **{kind: x.numpy()})  # pyright: ignore[reportArgumentType]
    print(f"{out}: {n} {kind}s of {'x'.join(map(str, x.shape[1:]))}")

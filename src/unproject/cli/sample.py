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
    """Draw new things from a run into an .npz file, float32.

    `volume` (N, X, Y, Z); or `image` (N, 1, H, W); or `diffuse`, `specular`, `roughness` and `normal` (N, C, H, W),
    linear, and `fresnel`, how the specular albedo is meant.

    Args:
        path: the run directory.
        n: how many.
        seed: which; the same seed gives the same things.
        out: the file to write.
        trust: import the generator's code although it is not of this package.
    """
    import numpy as np

    from .._files import atomic_path
    from ..ops.maps import kind_of, unpack_maps
    from ..training import load
    from ..training.run_directory import naming

    if n < 1:
        raise UserError(f"--n {n}: give at least 1")
    if out.suffix != ".npz":
        raise UserError(f"--out {out}: give a name that ends in .npz")
    x = load(path, trust).generator.sample(n, seed)
    kind = kind_of(x)
    arrays = {name: part.numpy() for name, part in unpack_maps(x).items()} if kind == "maps" else {kind: x.numpy()}
    said = {"fresnel": np.array("albedo")} if kind == "maps" else {}
    with naming(out), atomic_path(out) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays, **said)  # pyright: ignore[reportArgumentType]
    called = "sets of maps" if kind == "maps" else f"{kind}s"
    print(f"{out}: {n} {called} of {'x'.join(map(str, x.shape[1:]))}")

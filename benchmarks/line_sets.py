"""Sets of images beside digits: masks of birds, phantoms as in tomography, characters of a script that nobody writes.

    python benchmarks/line_sets.py --data SHARED --out OUT
    unproject train digits --data OUT/birds.npz --views known --minutes 5 --out OUT/run
    python benchmarks/fit_images.py --data OUT/birds_test.npz --run OUT/run --n 60 --out OUT/fits

OUT/NAME.npz has training images (N, 32, 32) of eight bits, OUT/NAME_test.npz twenty of them and sixty others; of the
script there are 1,000 others in OUT/script_held_out.npz.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F

TEST, TUNED, SIDE, CHARACTERS, HELD_OUT = 60, 20, 32, 30, 1000


def birds(data: Path) -> np.ndarray:
    """Return masks (N, 32, 32) in [0, 1], in an order drawn once."""
    with np.load(data / "silhouettes" / "bird_cub_aves_64.npz") as arrays:
        masks = torch.from_numpy(next(arrays[name] for name in arrays if arrays[name].ndim == 3)).float()
    order = torch.randperm(len(masks), generator=torch.Generator().manual_seed(0))
    return F.avg_pool2d((masks / masks.max())[:, None], 2)[order, 0].numpy()


def phantoms(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return images (count, 32, 32) in [0, 1]: an ellipse with two to four smaller ones, darker or brighter, in it."""
    y, x = np.mgrid[0 : 2 * SIDE, 0 : 2 * SIDE] / SIDE - 1 + 0.5 / SIDE
    found = []
    for _ in range(count):
        image = np.zeros(x.shape)

        def paint(cx: float, cy: float, a: float, b: float, turn: float, value: float, on: np.ndarray = image) -> None:
            u, v = (x - cx) * np.cos(turn) + (y - cy) * np.sin(turn), (y - cy) * np.cos(turn) - (x - cx) * np.sin(turn)
            on[(u / a) ** 2 + (v / b) ** 2 < 1] = value

        a, b = rng.uniform(0.55, 0.85), rng.uniform(0.4, 0.7)
        paint(0, 0, a, b, rng.uniform(-0.3, 0.3), rng.uniform(0.3, 0.5))
        for _ in range(rng.integers(2, 5)):
            place = rng.uniform(-0.4, 0.4) * a / 0.7, rng.uniform(-0.4, 0.4) * b / 0.7
            paint(
                *place,
                rng.uniform(0.06, 0.22),
                rng.uniform(0.06, 0.22),
                rng.uniform(0, 3),
                rng.choice([0.1, 0.7, 0.9, 1.0]),
            )
        found.append(image.reshape(SIDE, 2, SIDE, 2).mean((1, 3)))
    return np.stack(found)


def script(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return images (count, 32, 32) in [0, 1] of thirty characters, each of two or three curved strokes.

    A stroke is a quadratic Bézier curve. Its three points are those of its character, moved at random with all others
    by an affine map and each by itself; pens are 1.2 to 2 pixels wide.
    """
    characters = [rng.uniform(-0.62, 0.62, (rng.integers(2, 4), 3, 2)) for _ in range(CHARACTERS)]
    for strokes in characters:
        strokes[1:, 0] = strokes[:-1, 2]  # most pens are not lifted
    t = np.linspace(0, 1, 32)[:, None]
    place = (np.mgrid[0:SIDE, 0:SIDE] / SIDE * 2 - 1 + 1 / SIDE).transpose(1, 2, 0)
    found = np.empty((count, SIDE, SIDE))
    for image in found:
        strokes = characters[rng.integers(CHARACTERS)]
        affine = np.diag(rng.uniform(0.85, 1.1, 2)) + rng.normal(0, 0.08, (2, 2))
        points = strokes @ affine.T + rng.normal(0, 0.04, strokes.shape)
        a, b, c = points[:, None, 0], points[:, None, 1], points[:, None, 2]
        curve = ((1 - t) ** 2 * a + 2 * t * (1 - t) * b + t**2 * c).reshape(-1, 2)
        away = np.sqrt(((place[:, :, None] - curve) ** 2).sum(-1).min(2)) * SIDE / 2
        image[:] = np.clip(rng.uniform(0.6, 1.0) + 0.5 - away, 0, 1)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="the folder that holds silhouettes/")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    sets = {"birds": birds(given.data), "phantoms": phantoms(2000 + TEST, np.random.default_rng(1))}
    sets["script"], held_out = np.split(script(8000 + TEST + HELD_OUT, np.random.default_rng(2)), [8000 + TEST])
    np.savez(given.out / "script_held_out.npz", x=(255 * held_out).round().astype(np.uint8))
    for name, images in sets.items():
        test, training = np.split((255 * images).round().astype(np.uint8), [TEST])
        np.savez(given.out / f"{name}.npz", x=training)
        np.savez(given.out / f"{name}_test.npz", x=np.concatenate([training[:TUNED], test]))


if __name__ == "__main__":
    main()

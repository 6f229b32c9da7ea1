"""Train the classifiers whose features digits are scored on, and write the weights that the package carries.

    python tools/train_digit_classifier.py --data FOLDER_OF_MNIST --out src/unproject/metrics
    python tools/train_digit_classifier.py --data FOLDER_OF_MNIST --out src/unproject/metrics --turned

Trained on the 60000 training images of MNIST and, an eighth of every batch, the 1500 embedded digits, each turned,
scaled and shifted a little; with --turned each at any angle, half of them mirrored. Writes digit_classifier.safetensors
or turned_digit_classifier.safetensors (half precision), with its accuracy on the test images of both as metadata
(turned and mirrored at random by `ops.turn_image` if --turned), and prints them.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from torch import Tensor

from unproject._random import generator_at, seeded
from unproject.data import digit_labels, digits
from unproject.data.readers.arrays import read_idx
from unproject.metrics.digit_classifier import TURNED, UPRIGHT, DigitClassifier
from unproject.ops.turning import turn_image

BATCH, RATE = 256, 3e-3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with the four idx files of MNIST")
    parser.add_argument("--out", type=Path, required=True, help="folder of the weights")
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--turned", action="store_true", help="digits at any turn, mirrored or not")
    options = parser.parse_args()
    mnist = [mnist_part(options.data, part) for part in ("train", "t10k")]
    embedded = [(digits(32, held_out), digit_labels(held_out)) for held_out in (False, True)]
    classifier = train([mnist[0], embedded[0]], options.steps, options.seed, options.turned)
    tests = {"mnist": mnist[1], "embedded": embedded[1]}
    if options.turned:
        tests = {name: (anyhow(images, options.seed), labels) for name, (images, labels) in tests.items()}
    accuracy = {name: accuracy_on(classifier, *test) for name, test in tests.items()}
    about = {f"accuracy_{name}": f"{value:.4f}" for name, value in accuracy.items()}
    about |= {"steps": str(options.steps), "batch": str(BATCH), "seed": str(options.seed)}
    weights = {name: value.half() for name, value in classifier.state_dict().items()}
    save_file(weights, options.out / f"{TURNED if options.turned else UPRIGHT}.safetensors", about)
    print(about)


def mnist_part(folder: Path, part: str) -> tuple[Tensor, Tensor]:
    images, labels = (read_idx(folder / f"{part}-{what}-ubyte.gz") for what in ("images-idx3", "labels-idx1"))
    return F.pad(torch.from_numpy(images.copy()).float()[:, None] / 255, (2, 2, 2, 2)), torch.from_numpy(labels.copy())


def train(sets: list[tuple[Tensor, Tensor]], steps: int, seed: int, turned: bool) -> DigitClassifier:
    with seeded(seed, "classifier"):
        classifier = DigitClassifier()
    optimiser = torch.optim.AdamW(classifier.parameters(), RATE, weight_decay=1e-3)
    shares = (BATCH - BATCH // 8, BATCH // 8)
    for step in range(steps):
        rng = generator_at(seed, step, "batch")
        parts = [rows_of(data, n, rng) for data, n in zip(sets, shares, strict=True)]
        images, labels = (torch.cat(column) for column in zip(*parts, strict=True))
        optimiser.param_groups[0]["lr"] = RATE * (1 + math.cos(math.pi * step / steps)) / 2
        loss = F.cross_entropy(classifier(jittered(images, rng, turned))[1], labels.long(), label_smoothing=0.02)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        if step % 200 == 0:
            print(step, round(loss.item(), 4), flush=True)
    return classifier.eval()


def rows_of(data: tuple[Tensor, Tensor], n: int, rng: torch.Generator) -> tuple[Tensor, Tensor]:
    rows = torch.randint(len(data[0]), (n,), generator=rng)
    return data[0][rows], data[1][rows]


def anyhow(images: Tensor, seed: int) -> Tensor:
    """Return images turned by any angle, half of them mirrored."""
    rng = generator_at(seed, 0, "turns")
    angle, mirrored = torch.rand(len(images), generator=rng) * 2 * math.pi, torch.rand(len(images), generator=rng) < 0.5
    parts = zip(images.split(500), angle.split(500), mirrored.split(500), strict=True)
    return torch.cat([turn_image(*part) for part in parts])


def jittered(images: Tensor, rng: torch.Generator, turned: bool) -> Tensor:
    """Turned by up to 10°, scaled by up to 8 % and shifted by up to 2 pixels of 32; or turned anyhow, half mirrored."""
    n = len(images)
    if turned:
        images = torch.where(torch.rand(n, 1, 1, 1, generator=rng) < 0.5, images.flip(3), images)
    turn, scale, dx, dy = ((torch.rand(n, generator=rng) * 2 - 1) * most for most in (0.17, 0.08, 0.125, 0.125))
    turn = torch.rand(n, generator=rng) * 2 * math.pi if turned else turn
    c, s = turn.cos() / (1 + scale), turn.sin() / (1 + scale)
    matrix = torch.stack([torch.stack([c, s, dx], 1), torch.stack([-s, c, dy], 1)], 1)
    return F.grid_sample(images, F.affine_grid(matrix, list(images.shape), align_corners=False), align_corners=False)


@torch.no_grad()
def accuracy_on(classifier: DigitClassifier, images: Tensor, labels: Tensor) -> float:
    guessed = torch.cat([classifier(part)[1].argmax(1) for part in images.split(500)])
    return (guessed == labels).double().mean().item()


if __name__ == "__main__":
    main()

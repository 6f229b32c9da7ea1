"""What each of two processes does in tests/test_processes.py: `python averaging.py FOLDER`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import torch
from pair import in_two
from toy import BINS, jointly, toy

import unproject.training.loop as loop
from unproject.adversarial.losses import Wasserstein
from unproject.assignment import Estimator
from unproject.domains import Domain
from unproject.networks import Discriminator
from unproject.training import health, train, trainer
from unproject.training.distribution import Distribution


def gradient(images: torch.Tensor, distribution: Distribution | None) -> torch.Tensor:
    """Of a discriminator without batch statistics on a batch of pairs."""
    torch.manual_seed(0)
    network = Discriminator((1, 16, 16), heads=3, channels=4)
    heads = torch.zeros(len(images) // 2, dtype=torch.int64)
    real, fake = images.chunk(2)
    Wasserstein().discriminator(network(real, heads), network(fake, heads)).backward()
    if distribution is not None:
        distribution.average_gradients(network)
    return torch.cat([p.grad.flatten() for p in network.parameters() if p.grad is not None])


def one_collapsed(distribution: Distribution) -> float:
    """Every process must see the same diversity, or one would go back and leave the others waiting."""
    images = torch.rand(4, 1, 2, 2, generator=torch.Generator().manual_seed(0))
    return distribution.average(health.diversity(images, images * (1 - distribution.rank)))


def remembering(owner: Any, name: str) -> list[Any]:
    """What every later call of `owner.name` returns."""
    function, results = getattr(owner, name), []

    def call(*arguments: Any) -> Any:
        results.append(function(*arguments))
        return results[-1]

    setattr(owner, name, call)
    return results


def main(folder: Path) -> None:
    torch.set_num_threads(1)
    trainer.EVERY = 2
    distribution = Distribution("cpu")
    rank = distribution.rank
    real, fake = torch.rand(2, 8, 1, 16, 16, generator=torch.Generator().manual_seed(1))
    half = slice(4 * rank, 4 * rank + 4)
    found = {
        "whole": gradient(torch.cat([real, fake]), None),
        "halves": gradient(torch.cat([real[half], fake[half]]), distribution),
    }
    (given,) = tensors = [torch.full((2,), rank)]
    distribution.copy_from_leader(tensors)
    wide = torch.tensor([200, 300], dtype=torch.int16) * (1 - rank)  # views of more than 128, which gloo does not send
    distribution.copy_from_leader([wide])
    agreed = [distribution.agree(rank == 1), distribution.agree(False)]
    diversity = one_collapsed(distribution)

    states, recorders, creations, saves, pictures = (
        remembering(*where)
        for where in (
            (loop, "State"),
            (loop, "Recorder"),
            (loop.run_directory, "create"),
            (loop.checkpoint, "save"),
            (Domain, "write_preview"),
        )
    )
    train(toy(steps=4, checkpoint_every=2, discriminator_steps=2), folder / "run", device="cpu", quiet=True)
    (state,) = states
    writes = [len(creations), len(saves), len(pictures), recorders[0].file.name]
    joint = jointly(toy(steps=4, starts=(0.5,)), weight=3.0)
    train(joint, folder / "joint", device="cpu", quiet=True)
    learned = states[-1].panels[0].assignment
    assign = Estimator.assign
    # As on a machine that computes a little otherwise.
    Estimator.assign = lambda *given: tuple((found + rank) % BINS for found in assign(*given))  # type: ignore[assignment]
    train(toy(steps=1, starts=(0.9,)), folder / "started", start=folder / "run", device="cpu", quiet=True)
    sums = {
        f"{i}/{name}": float(p.double().sum())
        for i, module in enumerate((state.generator, state.discriminators, state.average))
        for name, p in module.named_parameters()
    }
    report = {
        "difference": float((found["whole"] - found["halves"]).abs().max()),
        "size": float(found["whole"].abs().max()),
        "copied": given.tolist(),
        "wide": wide.tolist(),
        "averaged": distribution.average(0.1),
        "agreed": agreed,
        "diversity": diversity,
        "sums": sums,
        "writes": writes,
        "views": state.panels[0].assignment.views.tolist(),
        "predictor": [float(p.double().sum()) for p in learned.predictor.parameters()],
        "predicted": learned.views.tolist(),
        "started": states[-1].panels[0].assignment.views.tolist(),
    }
    (folder / f"rank-{rank}.json").write_text(json.dumps(report))


if __name__ == "__main__":
    in_two(lambda: main(Path(sys.argv[1])))

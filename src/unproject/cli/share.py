"""`unproject share RUN`."""

from __future__ import annotations

from pathlib import Path

from .._types import UserError
from ._machine import say


def run(
    path: Path,
    /,
    *,
    out: Path | None = None,
    push: str | None = None,
    public: bool = False,
    trust: bool = False,
) -> None:
    """Write a run for others, or send it to the Hugging Face Hub: weights in 16 bits, recipe, verdict and a model card.

    What is written is a run directory: it can be sampled, exported and explored anywhere, but not resumed; `fit` needs
    the training data. Nothing in it is executable, and it names no folder of this machine. A generator or domain of
    your own is not in it: others need its code too.

    Args:
        path: the run directory.
        out: the folder to make.
        push: OWNER/NAME on the hub, in the place of a run that is there; needs pip install 'unproject[hub]', and
            `hf auth login`.
        public: with --push, let everybody see it; without, a public OWNER/NAME is refused.
        trust: import the run's code although it is not of this package.
    """
    from ..sharing import push_to_hub, save_pretrained
    from ..training.building import foreign_code

    if (out is None) == (push is None):
        raise UserError("share: give either --out FOLDER or --push OWNER/NAME")
    if out is not None:
        shared = save_pretrained(path, out, trust)
        say(f"{shared}: shared; open it with unproject.from_pretrained, sample, export or studio")
    if push is not None:
        say(f"{push_to_hub(path, push, private=not public, trust=trust)}: shared")
    if foreign := foreign_code(path):
        say(f"others need code that is not in it: {', '.join(foreign)}; give it to them, and tell them of --trust")

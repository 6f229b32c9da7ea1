"""Random flags and values of the command line, for `tools/fuzz.py`: known verbs and flags, odd values."""

from __future__ import annotations

import inspect
import re
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

VALUES = (
    "0", "-1", "1", "2", "3", "nan", "inf", "-inf", "1e999", "1e-320", "1e9", "0.5", "1000000000", "9223372036854775808", "100000",
    "", " ", "x", "é", "\x1b[31m", "a\nb", "None", "true", "..", ".", "/dev/null", "/dev/zero", "in", "in/x.npz", "in/masks", "missing",
    "x" * 300, "30,10", "nan,0", "directional:nan,0", "env:in/x.npz", "env:missing", "ambient", "albedo", "eta", "half", "glb", "png",
    "auto", "dark", "crop", "keep", "known", "predicted", "direct", "single", "0.1 0.2", "-", "--", "{}", "%s", "$HOME",
)  # fmt: skip
VERBS = (
    "train",
    "resume",
    "sample",
    "evaluate",
    "report",
    "export",
    "fit",
    "render",
    "reproduce",
    "recipes",
    "check",
    "data",
)
SHORT = {
    "train": ("--steps", "1", "--quiet"), "resume": ("--steps", "2", "--quiet"), "fit": ("--candidates", "2", "--steps", "1"),
    "reproduce": ("--report",), "evaluate": ("--n", "4"),
}  # fmt: skip
"""What keeps a good command from taking minutes; it comes first, so that a random flag may override it."""
FIXED = ("steps", "minutes", "candidates", "starts")
"""Flags that may ask for hours of work, by right."""


LONG, MANY, LARGE = ("--tune", "--discriminator-steps"), 10_000, ("shapes-paper",)
"""Further flags that ask for hours where their value is large, and recipes of which a step may take a minute."""


def asks_for_hours(words: list[str]) -> bool:
    """Whether a command may take long by right.

    Examples:
        >>> asks_for_hours(["fit", "in", "--tune", "0", "--tune", "1e9"]), asks_for_hours(["train", "toy"])
        (True, False)
    """
    given = [value for name, value in zip(words, words[1:]) if name in LONG]
    numbers = [float(value) for value in given if re.fullmatch(r"[\d.]+(e\d+)?", value)]
    return max(numbers, default=0) >= MANY or any(recipe in words[1:2] for recipe in LARGE)


def of(rng: np.random.Generator, options: Any) -> Any:
    return options[int(rng.integers(len(options)))]


@cache
def flags_of(verb: str, recipe: str = "") -> tuple[str, ...]:
    """The flags of a verb, and of a recipe."""
    from fuzz_seeds import TOY

    from unproject import recipes
    from unproject._objects import find_object
    from unproject.training import Options

    module = import_module(f"unproject.cli.{verb}")
    functions = list(module.ACTIONS.values()) if verb == "data" else [module.run]
    if recipe:
        functions.append(find_object(f"{TOY}:toy") if recipe == "toy" else recipes.find(recipe))
    names = [
        name
        for function in functions
        for name, p in inspect.signature(function).parameters.items()
        if p.kind is p.KEYWORD_ONLY
    ]
    return tuple(dict.fromkeys([*names, *(Options.__annotations__ if recipe else ())]))


def words(rng: np.random.Generator) -> list[str]:
    """A command: a verb, what it is about, and one to three flags with odd values."""
    from fuzz_seeds import TOY

    verb = of(rng, VERBS)
    recipe = (
        of(rng, ("toy", "toy", "shapes", "digits", "wood", "shapes-paper", "digits-paper", "wood-paper"))
        if verb == "train"
        else ""
    )
    found = [verb, *subject(verb, recipe, str(TOY), rng), *SHORT.get(verb, ())]
    for _ in range(int(rng.integers(1, 4))):
        name = of(rng, flags_of(verb, recipe) or ("x",))
        if name not in FIXED:
            found += [f"--{name.rstrip('_').replace('_', '-')}", *([of(rng, VALUES)] if rng.random() < 0.9 else [])]
    if rng.random() < 0.05:
        found.insert(int(rng.integers(1, len(found))), of(rng, VALUES))
    return [word.replace("\x00", "") for word in found]


def subject(verb: str, recipe: str, toy: str, rng: np.random.Generator) -> list[str]:
    if verb == "train":
        return [f"{toy}:toy" if recipe == "toy" else recipe, "--out", "out"]
    if verb in ("resume", "sample", "evaluate", "report"):
        return ["in", "--trust"]
    if verb == "export":
        return [of(rng, ("in", "in/x.npz", "in/maps.npz")), "--trust", "--out", of(rng, ("out", "out.png", "out.npz"))]
    if verb == "fit":
        return [
            "in",
            of(rng, ("in/x.npz", "in/masks", "in/masks/a.png")),
            "--trust",
            "--tune",
            "0",
            "--no-novelty",
            "--out",
            "out",
        ]
    if verb == "render":
        return ["in/maps.npz", "--samples", "2", "--out", "out.png"]
    if verb == "data":
        return [of(rng, ("inspect", "pack")), of(rng, ("in/masks", "in/x.npz"))]
    if verb == "check":
        return [of(rng, ("unproject:Silhouette", f"{toy}:Layer", "os:system", "x", "math:pi", f"{toy}:toy"))]
    return [of(rng, ("fig3", "fig1", "all", "list", "show", "shapes", "x"))]


@cache
def tree() -> dict[str, bytes]:
    """A run, a folder of masks, volumes and maps."""
    from fuzz_seeds import maps, npz, picture, run, volumes

    masks = {f"in/masks/{name}.png": picture("png") for name in "abc"}
    return {**run()[0], **masks, "in/x.npz": npz(volume=volumes()), "in/maps.npz": npz(**maps())}

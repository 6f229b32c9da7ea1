"""The recipes of materials: what each observation is paired with, and a toy run of each from the command line."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import load_file

from unproject._types import UserError
from unproject.cli import main
from unproject.data import correlated, metal, procedural_probes, wood
from unproject.ops.maps import MAPS
from unproject.projections.base import Identity
from unproject.projections.observation import Observation
from unproject.projections.priors import Product
from unproject.projections.standardised import Standardised
from unproject.recipes import names
from unproject.recipes.materials import (
    MIRRORED,
    SEEN_FROM,
    materials,
    metal_materials,
    mirrored,
    way_of,
    wood_materials,
    wood_paper,
)
from unproject.training import resume, train
from unproject.training.panel import build_panels

TOY = {"size": 16, "steps": 2, "batch": 4, "channels": 16, "judge": 4}


def test_each_observation_has_materials_of_its_own_and_a_discriminator_of_its_own() -> None:
    recipe = materials(wood, looks=(*MAPS, "top", "grazing"), maps=6, renderings=5, **TOY)
    found = {look.name: (look, collection) for look, collection in recipe.looks}
    assert list(found) == [*MAPS, "top", "grazing"]
    assert [len(collection) for _, collection in found.values()] == [6, 6, 6, 6, 5, 5]
    panels = build_panels(recipe)
    assert len(panels) == 6 and len({id(panel.discriminator) for panel in panels}) == 6
    for look, collection in found.values():
        assert isinstance(look.projection, Standardised)
        torch.testing.assert_close(collection.items.mean(), torch.tensor(0.5), atol=0.03, rtol=0)
    # The diffuse and the specular maps are of different materials: undone, they are no pair of the world.
    diffuse, specular = (found[name][0].projection.restore(found[name][1].items) for name in ("diffuse", "specular"))  # pyright: ignore
    own = wood(6, 16, 1)
    assert not np.isclose(diffuse.mean((1, 2, 3)), own[:, :3].mean((1, 2, 3)), atol=1e-4).any()
    assert specular.shape == (6, 1, 16, 16)


def test_the_same_seed_is_the_same_collection() -> None:
    first, again, other = (materials(metal, maps=3, renderings=2, seed=seed, **TOY) for seed in (1, 1, 2))
    for (_, a), (_, b), (_, c) in zip(first.looks, again.looks, other.looks, strict=True):
        assert torch.equal(a.items, b.items) and not torch.equal(a.items, c.items)


def test_any_mix_of_observations() -> None:
    names = ("flash", "lamp", "raking", "coloured", "top", "ambient")
    lights = wood_materials(looks=names, renderings=3, **TOY)
    assert tuple(look.name for look, _ in lights.looks) == names
    assert [look.name for look, _ in wood_materials(maps=2, renderings=0, **TOY).looks] == [*MAPS]
    with pytest.raises(UserError, match="choose from"):
        wood_materials(looks=("smell",), **TOY)
    with pytest.raises(UserError, match="at least one"):
        wood_materials(maps=0, renderings=0, **TOY)


def test_photographs_count_more_than_maps() -> None:
    looks = [look for look, _ in wood_materials(maps=2, renderings=2, emphasis=2.5, **TOY).looks]
    assert {look.name: look.weight for look in looks} == dict.fromkeys(MAPS, 1.0) | dict.fromkeys(
        ("flash", "coloured", "ambient"), 2.5
    )


def test_discriminators_of_photographs_are_smoother() -> None:
    looks = [look for look, _ in wood_materials(maps=2, renderings=2, smoothing=7.0, **TOY).looks]
    assert {look.smoothing for look in looks if look.name in MAPS} == {1.0}
    assert {look.smoothing for look in looks if look.name not in MAPS} == {7.0}


@pytest.mark.parametrize("look", sorted(MIRRORED))
def test_a_mirror_image_is_what_is_seen_of_the_mirrored_material(look: str) -> None:
    maps = correlated(3, 16, 0)
    natural = procedural_probes(8)[0][:1]
    way = Observation(look, Identity(), Product()) if look == "itself" else way_of(look, natural, 1024)
    drawn = way.prior.sample(3, torch.Generator().manual_seed(0))
    drawn |= {"view": torch.zeros(3)} if "view" in drawn else {}
    turns = {(3,): lambda phi: math.pi - phi, (2,): lambda phi: -phi, (2, 3): lambda phi: phi + math.pi}
    moves = {"lamp": "light_azimuth", "top": "light"}.get(look)  # light that comes from anywhere is mirrored, or turned
    for axes in MIRRORED[look]:
        of_mirrored = drawn | ({moves: turns[axes](drawn[moves])} if moves else {})
        torch.testing.assert_close(
            way.projection(mirrored("itself", maps, axes), **of_mirrored),
            mirrored(look, way.projection(maps, **drawn), axes),
            atol=0.02,
            rtol=0,
        )


def test_direct_training_sees_as_many_images() -> None:
    recipe = wood_materials(views="direct", maps=6, renderings=4, **TOY)
    ((look, collection),) = recipe.looks
    assert look.name == "itself" and collection.items.shape == ((4 * 6 + 3 * 4) // 4, 8, 16, 16)


def test_the_worlds_differ() -> None:
    shine = []
    for recipe in (wood_materials, metal_materials):
        ((look, _),) = recipe(looks=("specular",), maps=8, **TOY).looks
        shine.append(look.projection.mean[0])
    assert shine[1] > 3 * shine[0]


def test_the_papers_recipe_has_the_papers_choices() -> None:
    recipe = wood_paper(maps=4, renderings=2, **TOY)
    adam = recipe.generator_optimiser
    assert (adam.rate, adam.beta1, adam.beta2, recipe.discriminator_steps) == (1e-4, 0.5, 0.9, 1)
    assert recipe.generator().code_size == 512


def test_pictures_of_a_users_own(tmp_path: Path) -> None:
    """Sub-folders of photographs and maps that do not belong together are enough."""
    rng = np.random.default_rng(0)
    for name, count in (("top", 5), ("grazing", 4), ("diffuse", 3)):
        (tmp_path / name).mkdir()
        for k in range(count):
            Image.fromarray(rng.integers(0, 255, (20, 24, 3), dtype=np.uint8)).save(tmp_path / name / f"{k}.png")
    recipe = wood_materials(data=tmp_path, **TOY)
    assert [(look.name, len(collection)) for look, collection in recipe.looks] == [
        ("diffuse", 3),
        ("top", 5),
        ("grazing", 4),
    ]
    assert [look.name for look, _ in wood_materials(data=tmp_path, looks=("top",), **TOY).looks] == ["top"]
    # Nobody knows their light, and they count less than maps; our own renderings of top views count as all do.
    weights = {look.name: look.weight for look, _ in wood_materials(data=tmp_path, natural=0.25, **TOY).looks}
    assert weights == {"diffuse": 1.0, "top": 0.25, "grazing": 0.25}
    ours = wood_materials(looks=("top", "flash"), renderings=2, emphasis=2.5, **TOY)
    assert [look.weight for look, _ in ours.looks] == [2.5, 2.5]
    with pytest.raises(UserError, match="out of --looks"):
        wood_materials(data=tmp_path, looks=("normal", "top"), **TOY)


def test_patches_of_a_few_large_materials(tmp_path: Path) -> None:
    large = {name: part.numpy() for name, part in zip(MAPS, wood(2, 64, 0).split([3, 1, 1, 3], 1), strict=True)}
    np.savez(tmp_path / "few.npz", **large)  # pyright: ignore[reportArgumentType]
    recipe = wood_materials(data=tmp_path / "few.npz", maps=20, renderings=10, **TOY)
    assert [len(collection) for _, collection in recipe.looks] == [20, 20, 20, 20, 10, 10, 10]


def test_a_killed_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    """The moving windows of the discriminators too."""
    recipe = wood_materials(looks=("diffuse", "flash"), maps=6, renderings=4, **TOY | {"steps": 6, "size": 64})
    recipe = recipe.replace(checkpoint_every=3)
    train(recipe, tmp_path / "run", quiet=True)
    _, last = sorted((tmp_path / "run" / "checkpoints").glob("*.safetensors"))
    before = load_file(last)
    last.unlink()
    resume(recipe, tmp_path / "run", quiet=True)
    after = load_file(last)
    differ = [name for name, value in before.items() if not torch.equal(value, after[name])]
    assert not [name for name in differ if "counters" not in name] and any("taken" in name for name in before)


@pytest.mark.parametrize("name", ["wood", "metal-paper"])
def test_a_toy_run_from_the_command_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = str(tmp_path / "run")
    flags = [part for key, value in TOY.items() for part in (f"--{key}", str(value))]
    assert main(["train", name, "--maps", "6", "--renderings", "4", *flags, "--out", run, "--quiet"]) == 0
    assert list((tmp_path / "run" / "samples").glob("*.png"))
    assert main(["resume", run, "--steps", "3", "--quiet"]) == 0
    assert main(["sample", run, "--n", "3", "--out", str(tmp_path / "s.npz")]) == 0
    with np.load(tmp_path / "s.npz") as arrays:
        assert [arrays[key].shape for key in MAPS] == [(3, c, 16, 16) for c in (3, 1, 1, 3)]
    assert main(["render", str(tmp_path / "s.npz"), "--samples", "8", "--out", str(tmp_path / "s.png")]) == 0
    assert main(["export", run, "--to", "maps", "--n", "2", "--out", str(tmp_path / "maps")]) == 0
    capsys.readouterr()
    assert main(["evaluate", run, "--n", "16", "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)
    assert scores and all({"value", "protocol", "n", "seed"} <= set(score) for score in scores.values())
    assert any("correlation" in key for key in scores)


def test_the_recipes_are_listed() -> None:
    assert {"wood", "metal", "plastic", "wood-paper", "metal-paper", "plastic-paper"} <= set(names())
    assert set(SEEN_FROM) == {"top", "grazing", "flash", "lamp", "raking", "coloured", "ambient"}

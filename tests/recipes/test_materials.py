"""The recipes of materials: what each observation is paired with, and a toy run of each from the command line."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import load_file

from unproject._types import UserError
from unproject.assignment import Panel
from unproject.cli import main
from unproject.data import correlated, metal, procedural_probes, wood
from unproject.data.readers.lights import KINDS
from unproject.domains import Maps
from unproject.ops.maps import MAPS, luminance, unpack_maps
from unproject.projections import Rendering
from unproject.projections.base import Identity
from unproject.projections.observation import Observation
from unproject.projections.standardised import Standardised
from unproject.recipes import find, names
from unproject.recipes.held_out import held_out, patches_of
from unproject.recipes.material_panels import MIRRORED, VIEWED_FROM, mirrored, natural_light, observation_of
from unproject.recipes.materials import materials, metal_materials, wood_materials, wood_paper
from unproject.testing import check_prior, check_projection
from unproject.training import Origin, Recipe, load, resume, train
from unproject.training.description import describe
from unproject.training.evaluation import projected
from unproject.training.state import State

TOY = {"size": 16, "steps": 2, "batch": 4, "channels": 16, "discriminator_channels": 4}


def panels(recipe: Recipe) -> dict[str, Panel]:
    """The panels by name; each has one observation and one collection."""
    assert all(len(panel.observations) == len(panel.collections) == 1 for panel in recipe.panels)
    return {panel.observations[0].name: panel for panel in recipe.panels}


def test_each_observation_has_materials_of_its_own_and_a_discriminator_of_its_own() -> None:
    recipe = materials(wood, observations=(*MAPS, "top", "grazing"), maps=6, renderings=5, **TOY)
    found = panels(recipe)
    assert list(found) == [*MAPS, "top", "grazing"]
    assert [len(panel) for panel in found.values()] == [6, 6, 6, 6, 5, 5]
    state = State(recipe, torch.device("cpu"))
    assert len(state.panels) == 6 and len({id(panel.discriminator) for panel in state.panels}) == 6
    for panel in found.values():
        assert isinstance(panel.projection, Standardised)
        torch.testing.assert_close(panel.collections[0].items.mean(), torch.tensor(0.5), atol=0.03, rtol=0)
    # The diffuse and the specular maps are of different materials: undone, they are no pair of the world.
    diffuse, specular = (
        found[name].projection.restore(found[name].collections[0].items)  # pyright: ignore
        for name in ("diffuse", "specular")
    )
    own = wood(6, 16, 1)
    assert not np.isclose(diffuse.mean((1, 2, 3)), own[:, :3].mean((1, 2, 3)), atol=1e-4).any()
    assert specular.shape == (6, 1, 16, 16)


def test_the_same_seed_is_the_same_collection() -> None:
    first, again, other = (materials(metal, maps=3, renderings=2, seed=seed, **TOY) for seed in (1, 1, 2))
    for a, b, c in zip(first.panels, again.panels, other.panels, strict=True):
        rows = torch.arange(len(a))
        assert torch.equal(a.batch(rows), b.batch(rows)) and not torch.equal(a.batch(rows), c.batch(rows))


def test_any_mix_of_observations() -> None:
    names = ("flash", "lamp", "raking", "coloured", "overhead", "slanting", "top", "ambient")
    lights = wood_materials(observations=names, renderings=3, **TOY)
    assert tuple(panels(lights)) == names
    assert [*panels(wood_materials(maps=2, renderings=0, **TOY))] == [*MAPS]
    with pytest.raises(UserError, match="choose from"):
        wood_materials(observations=("smell",), **TOY)
    with pytest.raises(UserError, match="at least one"):
        wood_materials(maps=0, renderings=0, **TOY)


@pytest.mark.parametrize("views", ["known", "direct"])
def test_a_run_of_before_a_photograph_goes_on_without(views: Literal["known", "direct"], tmp_path: Path) -> None:
    """Recipes write down now which observations they chose; runs of before did not, and had one fewer."""
    older = (*MAPS, "flash", "coloured", "ambient")
    flags: dict[str, Any] = {"maps": 4, "renderings": 4, "views": views, **TOY}
    train(wood_materials(observations=older, **flags), tmp_path / "run", quiet=True)
    file = tmp_path / "run" / "recipe.json"
    stored = json.loads(file.read_text())
    stored["arguments"]["observations"] = None
    file.write_text(json.dumps(stored))
    assert resume(tmp_path / "run", steps=3, quiet=True).step == 3
    origin = wood_materials(**flags).origin
    assert origin is not None and [*origin.arguments["observations"]] == [*older, "overhead"]


def test_a_run_of_before_there_were_waves_goes_on_without(tmp_path: Path) -> None:
    """Without what newer flags ask for a recipe is described as before there were the flags."""
    flags: dict[str, Any] = {"maps": 4, "renderings": 4, **TOY}
    older = wood_materials(waves=False, **flags)
    assert describe(older)["generator"]["arguments"] == {"size": 16, "channels": 16}
    assert describe(wood_materials(**flags))["generator"]["arguments"] == {"size": 16, "channels": 16, "cycles": 4}
    train(older, tmp_path / "run", quiet=True)
    file = tmp_path / "run" / "recipe.json"
    stored = json.loads(file.read_text())
    assert stored["arguments"].pop("waves") is False
    file.write_text(json.dumps(stored))
    assert resume(tmp_path / "run", steps=3, quiet=True).step == 3
    assert all("waves" not in name for name in load(tmp_path / "run").generator.state_dict())


@pytest.mark.parametrize("recipe", [wood_materials, wood_paper])
def test_runs_go_on_with_the_networks_that_they_began_with(recipe: Callable[..., Recipe], tmp_path: Path) -> None:
    train(recipe(maps=4, renderings=4, **TOY), tmp_path / "run", quiet=True)
    assert resume(tmp_path / "run", steps=3, quiet=True).step == 3


def test_photographs_count_more_than_maps() -> None:
    found = panels(wood_materials(maps=2, renderings=2, photograph_weight=2.5, **TOY))
    assert {name: panel.weight for name, panel in found.items()} == dict.fromkeys(MAPS, 1.0) | dict.fromkeys(
        ("flash", "coloured", "ambient", "overhead"), 2.5
    )


def test_discriminators_of_photographs_are_penalised_more() -> None:
    found = panels(wood_materials(maps=2, renderings=2, penalty_scale=7.0, **TOY))
    assert {panel.penalty_scale for name, panel in found.items() if name in MAPS} == {1.0}
    assert {panel.penalty_scale for name, panel in found.items() if name not in MAPS} == {7.0}


@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize("name", sorted(MIRRORED))
def test_a_mirror_image_is_the_projection_of_the_mirrored_material(name: str, coloured: bool) -> None:
    maps = correlated(3, 16, 0, coloured=coloured)
    natural = procedural_probes(8)[0][:1]
    observed = Observation(name, Identity()) if name == "itself" else observation_of(name, natural, 1024)
    drawn = observed.prior.sample(3, torch.Generator().manual_seed(0))
    drawn |= {"view": torch.zeros(3)} if "view" in drawn else {}
    turns = {(3,): lambda phi: math.pi - phi, (2,): lambda phi: -phi, (2, 3): lambda phi: phi + math.pi}
    # Light that comes from anywhere is mirrored, or turned.
    moves = {"lamp": "light_azimuth", "top": "light", "daylight": "light"}.get(name)
    for axes in MIRRORED[name]:
        of_mirrored = drawn | ({moves: turns[axes](drawn[moves])} if moves else {})
        torch.testing.assert_close(
            observed.projection(mirrored("itself", maps, axes), **of_mirrored),
            mirrored(name, observed.projection(maps, **drawn), axes),
            atol=0.02,
            rtol=0,
        )


def test_daylight_obeys_the_laws_of_projections_and_priors() -> None:
    observed = observation_of("daylight", None, 8)
    check_projection(observed, wood(3, 16, 0)[:, :, ::4, ::4])
    check_prior(observed.prior)


def test_daylight_needs_no_probes_and_comes_from_many_places() -> None:
    """A sheet of paper is as bright under each of them; a slope is lit from all sides, hardly or strongly."""
    observed = observation_of("daylight", None, 64)
    theta = observed.prior.sample(256, torch.Generator().manual_seed(0))
    assert theta["probe"].long().unique().numel() > 32 and theta["view"].abs().max() <= math.radians(5)
    paper = torch.tensor([0.5, 0.5, 0.5, 0, 0.5, 0, 0, 1]).view(1, 8, 1, 1).repeat(256, 1, 4, 4)
    seen = observed.projection(paper, **theta).mean((1, 2, 3))
    torch.testing.assert_close(seen, torch.full((256,), 0.5 ** (1 / 2.2)), atol=0.03, rtol=0)
    sides = []
    for lean in (0.4, -0.4):
        paper[:, 5], paper[:, 7] = lean, math.sqrt(1 - 0.4**2)
        sides.append(observed.projection(paper, **theta).mean((1, 2, 3)).log())
    ratio = sides[0] - sides[1]
    assert abs(ratio.mean()) < 0.05 and (ratio > 0.1).float().mean() > 0.2 and (ratio < -0.1).float().mean() > 0.2
    assert (ratio.abs() < 0.02).float().mean() > 0.05


def test_direct_training_sees_as_many_images() -> None:
    recipe = wood_materials(views="direct", maps=6, renderings=4, **TOY)
    ((name, panel),) = panels(recipe).items()
    assert name == "itself" and (len(panel), *panel.shape) == ((4 * 6 + 4 * 4) // 4, 8, 16, 16)


def test_the_procedural_data_sets_differ() -> None:
    shine = []
    for recipe in (wood_materials, metal_materials):
        (panel,) = recipe(observations=("specular",), maps=8, **TOY).panels
        shine.append(panel.projection.mean[0])
    assert shine[1] > 3 * shine[0]


def test_a_coloured_specular_albedo_is_an_option() -> None:
    plain, coloured = (
        metal_materials(maps=4, renderings=2, **TOY, **flag) for flag in ({}, {"coloured_specular": True})
    )
    assert plain.generator().sample(1).shape[1] == 8 and coloured.generator().sample(1).shape[1] == 10
    before, now = panels(plain), panels(coloured)
    assert before["specular"].shape == (1, 16, 16) and now["specular"].shape == (3, 16, 16)
    rows = torch.arange(4)
    assert torch.equal(before["roughness"].batch(rows), now["roughness"].batch(rows))
    one, three = (found["specular"].projection.restore(found["specular"].batch(rows)) for found in (before, now))  # pyright: ignore
    torch.testing.assert_close(luminance(three), one, atol=1e-5, rtol=0)


def test_colours_of_data_are_read_if_asked_for(tmp_path: Path) -> None:
    """Maps of ten channels are learned as eight without the flag, those of eight as ten with it."""
    gold = metal(4, 16, coloured=True)
    gold[:, 3:6] *= torch.tensor([1.0, 0.7, 0.3])[:, None, None]
    for name, maps in (("ten", gold), ("eight", metal(4, 16))):
        np.savez(tmp_path / f"{name}.npz", **{key: part.numpy() for key, part in unpack_maps(maps).items()})  # pyright: ignore
        for flag, shape in ((False, (1, 16, 16)), (True, (3, 16, 16))):
            recipe = wood_materials(
                data=tmp_path / f"{name}.npz", observations=("specular",), coloured_specular=flag, **TOY
            )
            assert recipe.panels[0].shape == shape
            if flag and name == "ten":
                red, _, blue = recipe.panels[0].projection.mean  # pyright: ignore[reportAttributeAccessIssue]
                assert red > 2 * blue
    (tmp_path / "folder" / "specular").mkdir(parents=True)
    Image.new("RGB", (16, 16), (255, 196, 87)).save(tmp_path / "folder" / "specular" / "gold.png")
    assert wood_materials(data=tmp_path / "folder", coloured_specular=True, **TOY).panels[0].shape == (3, 16, 16)


def test_data_may_be_named_by_a_string(tmp_path: Path) -> None:
    np.savez(tmp_path / "maps.npz", **{name: map_.numpy() for name, map_ in unpack_maps(wood(3, 16, 0)).items()})
    for recipe in ("materials", "wood", "wood-paper"):
        made = find(recipe)(data=str(tmp_path / "maps.npz"), size=16, steps=1)
        assert made.origin is not None and made.origin.arguments["data"] == {"path": str(tmp_path / "maps.npz")}


def test_runs_made_in_python_are_scored_against_held_out_samples_too() -> None:
    for recipe in ("digits", "digits-paper"):
        assert held_out(find(recipe)(steps=1).origin, 8, 5) is not None
    assert held_out(Origin("mine", "elsewhere:digits", {}), 8, 5) is None


def test_a_coloured_metal_is_scored_against_coloured_ones() -> None:
    """Those of the data set that it learns from; what is given is brought to its channels."""
    coloured = Origin("metal", "", {"coloured_specular": True})
    found, plain = held_out(coloured, 16, 6), held_out(Origin("metal", "", {}), 16, 6)
    assert found is not None and plain is not None and found.shape == (6, 10, 16, 16)
    assert unpack_maps(found)["specular"].std(1).max() > 0.05
    torch.testing.assert_close(Maps().comparable(found, plain)[:, 3:], plain[:, 3:], atol=1e-6, rtol=0)
    assert Maps().comparable(plain, found).shape == found.shape and Maps().comparable(found, found) is found


def test_textures_are_compared_as_patches_if_patches_were_learned(tmp_path: Path) -> None:
    """A weave of 16 threads a side: at 16 pixels whole textures are grey, patches are not."""
    stripes = np.kron(np.arange(256)[None] // 8 % 2, np.ones((256, 1))).astype(np.uint8) * 255
    for name in ("one", "two"):
        for role in ("diffuse", "roughness"):
            (tmp_path / "sets" / name).mkdir(parents=True, exist_ok=True)
            Image.fromarray(stripes).save(tmp_path / "sets" / name / f"{role}.png")
    learned = wood_materials(data=tmp_path / "sets", **TOY).origin
    patches = patches_of(Maps(), learned, tmp_path / "sets", 16, 5)
    assert patches_of(Maps(), wood_materials(**TOY).origin, tmp_path / "sets", 16, 5) is None
    whole = Maps().read(tmp_path / "sets", 16).floats()
    assert patches is not None and patches.shape == (5, 10, 16, 16)
    assert whole[:, 0].std() < 0.05 < patches[:, 0].flatten(1).std(1).median()


def test_a_coloured_metal_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, flags = str(tmp_path / "run"), [f"--{key.replace('_', '-')}={value}" for key, value in TOY.items()]
    train = ["train", "metal", "--coloured-specular", "--maps", "6", "--renderings", "4", *flags]
    assert main([*train, "--out", run, "--quiet"]) == 0
    assert main(["resume", run, "--steps", "3", "--quiet"]) == 0
    assert main(["sample", run, "--n", "3", "--out", str(tmp_path / "s.npz")]) == 0
    with np.load(tmp_path / "s.npz") as arrays:
        assert arrays["specular"].shape == (3, 3, 16, 16)
        sampled = arrays["specular"]
    for source in (run, str(tmp_path / "s.npz")):
        for to in ("maps", "mtlx", "gltf", "png", "npz"):
            assert main(["export", source, "--to", to, "--n", "2", "--out", str(tmp_path / f"{to}-{len(source)}")]) == 0
    with np.load(tmp_path / f"npz-{len(run)}" / "samples.npz") as arrays:
        assert np.array_equal(arrays["specular"], sampled[:2])
    assert main(["render", str(tmp_path / "s.npz"), "--samples", "8", "--out", str(tmp_path / "s.png")]) == 0
    for reference in ([], ["--reference", str(tmp_path / "eight.npz")]):
        np.savez(tmp_path / "eight.npz", **{key: part.numpy() for key, part in unpack_maps(metal(8, 16)).items()})  # pyright: ignore
        capsys.readouterr()
        assert main(["evaluate", run, "--n", "8", "--json", *reference]) == 0
        assert "patch_specular" in json.loads(capsys.readouterr().out)
    assert main(["report", run]) == 0


def test_the_papers_recipe_has_the_papers_choices() -> None:
    recipe = wood_paper(maps=4, renderings=2, **TOY)
    adam = recipe.generator_optimiser
    assert (adam.rate, adam.beta1, adam.beta2, recipe.discriminator_steps) == (1e-4, 0.5, 0.9, 1)
    assert recipe.generator().code_size == 512


def samples_of(panel: Panel) -> int:
    """Monte Carlo samples a pixel."""
    standardised = panel.projection
    assert isinstance(standardised, Standardised) and isinstance(standardised.projection, Rendering)
    return standardised.projection.sampling.samples


def test_pictures_of_a_users_own(tmp_path: Path) -> None:
    """Sub-folders of photographs and maps that do not belong together are enough."""
    rng = np.random.default_rng(0)
    for name, count in (("top", 5), ("grazing", 4), ("diffuse", 3), ("daylight", 2)):
        (tmp_path / name).mkdir()
        for k in range(count):
            Image.fromarray(rng.integers(0, 255, (20, 24, 3), dtype=np.uint8)).save(tmp_path / name / f"{k}.png")
    recipe = wood_materials(data=tmp_path, **TOY)
    assert [(name, len(panel)) for name, panel in panels(recipe).items()] == [
        ("diffuse", 3),
        ("top", 5),
        ("grazing", 4),
        ("daylight", 2),
    ]
    assert [*panels(wood_materials(data=tmp_path, observations=("top",), **TOY))] == ["top"]
    # They have no Monte Carlo noise, for which discriminators would tell what is rendered with few samples.
    taken = [panels(wood_materials(data=tmp_path, **TOY | given))["top"] for given in ({}, {"samples": 5})]
    assert [samples_of(panel) for panel in taken] == [32, 5]
    assert samples_of(panels(wood_materials(observations=("top",), renderings=2, **TOY))["top"]) == 8
    # Their light is unknown, and they count less than maps; our own renderings of top views count as all do.
    found = panels(wood_materials(data=tmp_path, natural_light_weight=0.25, **TOY))
    assert {name: panel.weight for name, panel in found.items()} == {
        "diffuse": 1.0,
        **dict.fromkeys(("top", "grazing", "daylight"), 0.25),
    }
    ours = wood_materials(observations=("top", "flash", "daylight"), renderings=2, photograph_weight=2.5, **TOY)
    assert [panel.weight for panel in ours.panels] == [2.5, 2.5, 2.5]
    with pytest.raises(UserError, match="leave normal out of the observations"):
        wood_materials(data=tmp_path, observations=("normal", "top"), **TOY)


def test_photographs_that_are_not_used_are_warned_of(tmp_path: Path) -> None:
    for name in ("daylight/a.png", "colored/b.png"):
        (tmp_path / name).parent.mkdir()
        Image.new("RGB", (16, 16), (150, 90, 60)).save(tmp_path / name)
    (tmp_path / "daylight" / "c.png").write_bytes(b"no picture")
    with pytest.warns(UserWarning) as warned:
        found = panels(wood_materials(data=tmp_path, **TOY))
    assert [(name, len(panel)) for name, panel in found.items()] == [("daylight", 1)]
    said = [str(one.message) for one in warned]
    assert len(said) == 2 and "not used: 1, the first: b.png" in said[0] and "'coloured'" in said[0]
    assert "1 of 2 skipped, the first: daylight/c.png" in said[1]


def test_daylight_is_learned_from_its_mirror_images_too(tmp_path: Path) -> None:
    (tmp_path / "daylight").mkdir()
    for k in range(3):
        Image.new("RGB", (16, 16), (150, 90, 60 + k)).save(tmp_path / "daylight" / f"{k}.png")
    (panel,) = wood_materials(data=tmp_path, flips=True, **TOY).panels
    assert len(panel) == 4 * 3


def test_all_photographs_are_used_unless_a_number_is_given(tmp_path: Path) -> None:
    (tmp_path / "flash").mkdir()
    for k in range(260):
        Image.new("RGB", (16, 16), (k % 256, 90, 60)).save(tmp_path / "flash" / f"{k}.png")
    assert [len(panel) for panel in wood_materials(data=tmp_path, **TOY).panels] == [260]
    assert [len(panel) for panel in wood_materials(data=tmp_path, renderings=7, **TOY).panels] == [7]


def test_patches_of_a_few_large_materials(tmp_path: Path) -> None:
    large = {name: part.numpy() for name, part in zip(MAPS, wood(2, 64, 0).split([3, 1, 1, 3], 1), strict=True)}
    np.savez(tmp_path / "few.npz", **large)  # pyright: ignore[reportArgumentType]
    recipe = wood_materials(data=tmp_path / "few.npz", maps=20, renderings=10, **TOY)
    assert [len(panel) for panel in recipe.panels] == [20, 20, 20, 20, 10, 10, 10, 10]


def test_a_killed_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    """The moving windows of the discriminators too."""
    recipe = wood_materials(observations=("diffuse", "flash"), maps=6, renderings=4, **TOY | {"steps": 6, "size": 64})
    recipe = recipe.replace(checkpoint_every=3)
    train(recipe, tmp_path / "run", quiet=True)
    _, last = sorted((tmp_path / "run" / "checkpoints").glob("*.safetensors"))
    before = load_file(last)
    last.unlink()
    resume(tmp_path / "run", recipe, quiet=True)
    after = load_file(last)
    differ = [name for name, value in before.items() if not torch.equal(value, after[name])]
    assert not [name for name in differ if "counters" not in name] and any("taken" in name for name in before)


@pytest.mark.parametrize("name", ["wood", "metal-paper"])
def test_a_toy_run_from_the_command_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = str(tmp_path / "run")
    flags = [part for key, value in TOY.items() for part in (f"--{key.replace('_', '-')}", str(value))]
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
    assert {"materials", "wood", "metal", "plastic", "fabric"} <= set(names())
    assert {"wood-paper", "metal-paper", "plastic-paper"} <= set(names())
    lit = {"top", "grazing", "flash", "lamp", "raking", "coloured", "overhead", "slanting", "ambient", "daylight"}
    assert set(VIEWED_FROM) == lit == {*KINDS}


def test_the_angles_of_fixed_lamps_are_those_of_the_conventions() -> None:
    """60, 36 or 12 degrees from the normal, 5 more or less, the red one or the only one at the left."""
    for name, theta in (("raking", 60), ("coloured", 60), ("slanting", 36), ("overhead", 12)):
        drawn = observation_of(name, None, 16).prior.sample(400, torch.Generator().manual_seed(0))
        light = drawn["light"].rad2deg()
        assert theta - 5.01 < light.min() < theta - 4.5 and theta + 4.5 < light.max() < theta + 5.01
        assert (drawn["light_azimuth"].rad2deg() - 180).abs().max() <= 5.01


def test_photographs_are_standardised_before_they_are_compared(tmp_path: Path) -> None:
    """Of maps and photographs of one shape nobody can tell which are meant."""
    recipe = wood_materials(observations=("flash",), renderings=12, **TOY)
    run = train(recipe, tmp_path / "run", quiet=True)
    (panel,) = recipe.panels
    scene = panel.projection
    assert isinstance(scene, Standardised)
    trained_on = panel.batch(torch.arange(12))
    (state,) = run.assignments()
    expected = run.domain.projection_scores(projected(state, run.sample(12), 0), trained_on, 0)
    found = run.evaluate(scene.restore(trained_on), n=12)
    assert expected
    for name, score in expected.items():
        assert found[name].value == pytest.approx(score.value, rel=1e-3)
    several = wood_materials(observations=("diffuse", "flash"), maps=4, renderings=4, **TOY)
    with pytest.raises(UserError, match="may be pictures of any of diffuse, flash"):
        train(several, tmp_path / "several", quiet=True).evaluate(trained_on, n=4)


def test_a_run_is_scored_by_photographs_that_were_held_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Sub-folders that the run has no observation for are left; its own pictures score as if they had been trained on.

    Each kind of pictures is standardised as in training.
    """
    rng = np.random.default_rng(0)
    for name in ("flash", "diffuse", "daylight"):
        (tmp_path / "own" / name).mkdir(parents=True)
        for k in range(8):
            pixels = rng.integers(0, 200 if name == "flash" else 80, (16, 16, 3), dtype=np.uint8)
            Image.fromarray(pixels).save(tmp_path / "own" / name / f"{k}.png")
    flags = [f"--{key.replace('_', '-')}={value}" for key, value in TOY.items()]
    run = str(tmp_path / "run")
    observed = ["--observations", "flash", "diffuse"]
    assert main(["train", "materials", "--data", str(tmp_path / "own"), *observed, *flags, "--out", run]) == 0
    scores = []
    for reference in ([], ["--reference", str(tmp_path / "own")]):
        capsys.readouterr()
        assert main(["evaluate", run, "--n", "8", "--json", *reference]) == 0
        scores.append(json.loads(capsys.readouterr().out))
    for name in ("patch_flash", "patch_diffuse"):
        assert scores[1][name]["value"] == pytest.approx(scores[0][name]["value"], rel=1e-3)
    assert "training" not in scores[1]["patch_flash"]["protocol"] and "patch_daylight" not in scores[1]
    (tmp_path / "others").mkdir()
    (tmp_path / "own" / "daylight").rename(tmp_path / "others" / "daylight")
    assert main(["evaluate", run, "--reference", str(tmp_path / "others")]) == 2
    assert "holds pictures of daylight, but the run saw flash, diffuse; give some" in capsys.readouterr().err
    shutil.copytree(tmp_path / "own", tmp_path / "few")
    for k in range(1, 8):
        (tmp_path / "few" / "flash" / f"{k}.png").unlink()
    assert main(["evaluate", run, "--reference", str(tmp_path / "few")]) == 2
    assert "flash: holds one picture that can be used; give two at least" in capsys.readouterr().err


def test_references_of_no_observation_are_refused(tmp_path: Path) -> None:
    run = train(wood_materials(observations=("flash",), renderings=12, **TOY), tmp_path / "run", quiet=True)
    with pytest.raises(UserError, match="the run has no observation 'lamp'; give pictures of flash"):
        run.evaluate({"lamp": torch.zeros(8, 3, 16, 16)}, n=8)
    with pytest.raises(UserError, match=r"references of flash are of shape \(1, 8, 8\); give pictures of shape"):
        run.evaluate({"flash": torch.zeros(8, 1, 8, 8)}, n=8)


def test_probes_that_light_nothing_are_warned_of(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match="not read, as no observation is lit by them"):
        assert natural_light(["diffuse", "flash"], tmp_path / "missing") is None
    with pytest.raises(UserError, match="missing"):
        natural_light(["top"], tmp_path / "missing")


def test_fewer_than_none_are_refused(tmp_path: Path) -> None:
    for name in ("maps", "renderings"):
        with pytest.raises(UserError, match="-3 images of a kind: give 0 or more"):
            wood_materials(steps=1, size=32, **{name: -3})


def test_direct_training_on_photographs_says_what_it_needs(tmp_path: Path) -> None:
    (tmp_path / "flash").mkdir()
    for k in range(2):
        Image.fromarray(np.full((64, 64, 3), 90 + k, np.uint8)).save(tmp_path / "flash" / f"{k}.png")
    with pytest.raises(UserError, match="holds pictures of materials; direct training needs materials"):
        wood_materials(data=tmp_path, views="direct", steps=1, size=32)


def test_another_batch_keeps_real_and_generated_images_apart(tmp_path: Path) -> None:
    """Deviations are over images of one kind, whatever the batch; and such a run is resumed by its folder."""
    recipe = wood_materials(maps=8, renderings=8, steps=1, size=32, channels=16, batch=4).replace(batch=6)
    assert {discriminator.group for discriminator in State(recipe, torch.device("cpu")).discriminators} == {6}
    assert resume(train(recipe, tmp_path / "run", quiet=True).path, steps=2, quiet=True).step == 2
    described = json.loads((tmp_path / "run" / "recipe.json").read_text())
    described["resolved"]["discriminator"]["arguments"]["group"] = 6  # as of before 28 November 2026
    (tmp_path / "run" / "recipe.json").write_text(json.dumps(described))
    assert resume(tmp_path / "run", steps=3, quiet=True).step == 3

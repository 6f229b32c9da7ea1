"""Operators of one's own: latents that turn nothing, pictures of any size and value, random masks, colour."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor

import unproject as up
from unproject.cli import main
from unproject.data.measured_lines import scale_of
from unproject.training.given_pictures import observed, references

SIDE = 32
GENERATOR = functools.partial(up.networks.SmoothImageGenerator, size=SIDE, channels=8)


class Hole(up.Projection):
    """A square of 14 pixels at (row, column) is missing."""

    linear, example_shape = True, (1, SIDE, SIDE)

    def forward(self, x: Tensor, *, row: Tensor, column: Tensor) -> Tensor:
        place = torch.arange(SIDE).to(x)
        inside = [((place >= at[:, None]) & (place < at[:, None] + 14)).to(x) for at in (row, column)]
        return x * (1 - inside[0][:, :, None] * inside[1][:, None, :])[:, None]


class Half(up.Projection):
    """A photograph of half as many pixels a side."""

    linear, example_shape = True, (1, SIDE, SIDE)

    def forward(self, x: Tensor) -> Tensor:
        return F.avg_pool2d(x, 2)


class Blur(up.Projection):
    """The same, out of focus."""

    linear, example_shape = True, (1, SIDE, SIDE)

    def forward(self, x: Tensor) -> Tensor:
        return F.avg_pool2d(F.avg_pool2d(x, 3, 1, 1), 2)


HOLE = up.Observation("hole", Hole(), up.Product(up.Uniform("row", 0, 18), up.Uniform("column", 0, 18)))
HALF, BLUR = up.Observation("half", Half()), up.Observation("blur", Blur())


def images(n: int = 60) -> Tensor:
    return up.data.digits(SIDE)[:n]


@up.resumable
def holes(*, seed: int = 0) -> up.Recipe:
    return up.Recipe(GENERATOR, [up.Panel([HOLE], up.data.observe(images(), [HOLE]))], steps=2, batch=4, seed=seed)


@up.resumable
def halves(*, seed: int = 0) -> up.Recipe:
    return up.Recipe(GENERATOR, [up.Panel([HALF], up.data.observe(images(), [HALF]))], steps=2, batch=4, seed=seed)


@pytest.fixture(scope="module")
def holed(tmp_path_factory: pytest.TempPathFactory) -> up.Run:
    return up.train(holes(), tmp_path_factory.mktemp("holed") / "run", quiet=True)


@pytest.fixture(scope="module")
def halved(tmp_path_factory: pytest.TempPathFactory) -> up.Run:
    return up.train(halves(), tmp_path_factory.mktemp("halved") / "run", quiet=True)


def test_latents_that_turn_nothing_leave_no_gauge(holed: up.Run) -> None:
    with pytest.warns(UserWarning, match="pictures of hole have the shape of samples"):
        scores = holed.evaluate(images(), n=8)
    assert "gauge_turn" not in scores


@pytest.mark.parametrize("domain", [up.Images(), up.Volumes()])
def test_only_the_latent_that_turns_samples_leaves_turns_open(domain: up.Domain) -> None:
    other = up.Observation("hole", Hole(), HOLE.prior)
    lines = up.projections.directions(4, spread=math.pi / 8)
    turning = lines if domain.turned_by == "angle" else up.projections.azimuth_bins(8, up.Silhouette(size=8))
    assert domain.turns([other], False) is None
    assert domain.turns(turning, False) in (8, 16) and domain.turns(turning, True) is None


def test_known_latents_of_ones_own_are_read_and_used(holed: up.Run, tmp_path: Path) -> None:
    viewing = up.inversion.Viewing.of([HOLE])
    x, row, column = images(3), torch.tensor([1.0, 5.0, 9.0]), torch.tensor([2.0, 3.0, 4.0])
    np.savez(tmp_path / "h.npz", image=Hole()(x, row=row, column=column)[:, 0], row=row, column=column)
    found = observed(holed, [tmp_path / "h.npz"], viewing)
    assert found.latents is not None and found.latents["row"].tolist() == row.tolist()
    search = up.inversion.Search(candidates=8, starts=1, steps=2, tune=0)
    fit = holed.fitter(search=search).fit(found.floats()[:1], {n: v[:1] for n, v in found.latents.items()})
    assert fit.consistent and fit.theta["column"][0, 0] == 2


def test_pictures_of_any_value_are_read_as_they_are(tmp_path: Path) -> None:
    signed = torch.randn(4, 24, 24)
    np.savez(tmp_path / "s.npz", image=signed)
    with pytest.raises(up.UserError, match=r"scale pictures and volumes to \[0, 1\]"):
        up.Collection.images(tmp_path / "s.npz")
    assert torch.equal(up.Collection.images(tmp_path / "s.npz", unbounded=True).floats()[:, 0], signed)
    halved = up.Collection.images(tmp_path / "s.npz", 12, unbounded=True).floats()
    torch.testing.assert_close(halved, F.avg_pool2d(signed[:, None], 2), atol=1e-6, rtol=0)


def test_references_may_be_pictures_of_an_operator(halved: up.Run, holed: up.Run, tmp_path: Path) -> None:
    np.savez(tmp_path / "half.npz", image=Half()(images(12))[:, 0])
    found = references(halved, tmp_path / "half.npz")
    assert isinstance(found, up.Collection) and found.shape == (1, 16, 16)
    assert "mmd_rms_picture" in halved.evaluate(found, n=8)
    assert "mmd_rms_picture_half" in halved.evaluate({"half": found.floats()}, n=8)
    assert "mmd_rms_picture" in halved.evaluate(n=8)
    np.savez(tmp_path / "hole.npz", image=images(12)[:, 0])
    named = references(holed, tmp_path / "hole.npz", "hole")
    assert isinstance(named, Mapping) and named["hole"].shape == (12, 1, 32, 32)
    with pytest.raises(up.UserError, match="the run has hole"):
        references(holed, tmp_path / "hole.npz", "hold")


def test_an_observation_is_named_for_references(capsys: pytest.CaptureFixture[str], halved: up.Run) -> None:
    assert main(["evaluate", str(halved.path), "--trust", "--observation", "half"]) == 2
    assert "give that too" in capsys.readouterr().err


def test_an_operator_without_latents_keeps_its_readings_where_noise_can_be_told(halved: up.Run) -> None:
    search, viewing = up.inversion.Search(candidates=8, starts=1, steps=2, tune=0), up.inversion.Viewing.of([BLUR])
    found = halved.fitter(search=search, viewing=viewing).fit(Blur()(images(1)))
    assert found.consistent and (Blur()(found.x[:1]) - Blur()(images(1))).abs().max() < 1e-3
    equal = halved.fitter(search=search).fit(Half()(images(1)))  # all means of pixels are as sensitive
    assert not equal.consistent


@pytest.mark.parametrize(
    ("given", "known", "said"),
    [
        (math.nan, {}, "pictures have values that are NaN"),
        (0.0, {"row": math.nan}, "known 'row' has values that are NaN"),
    ],
)
def test_what_is_not_finite_is_no_picture(holed: up.Run, given: float, known: dict[str, float], said: str) -> None:
    pictures = images(1) + given
    with pytest.raises(up.UserError, match=said):
        holed.fitter().fit(pictures, {name: torch.tensor([value]) for name, value in known.items()})


@pytest.mark.parametrize("known", [{"row": 1e4, "column": 3.0}, {"row": 3.0, "column": -1.0}])
def test_latents_that_no_training_had_are_warned_of(holed: up.Run, known: dict[str, float]) -> None:
    search = up.inversion.Search(candidates=8, starts=1, steps=1, tune=0)
    with pytest.warns(UserWarning, match="outside all that this run was trained on"):
        holed.fitter(search=search).fit(images(1), {name: torch.tensor([value]) for name, value in known.items()})


def test_readings_of_another_unit_are_warned_of(holed: up.Run) -> None:
    search = up.inversion.Search(candidates=8, starts=1, steps=1, tune=0)
    with pytest.warns(UserWarning, match="give them in the unit of projections"):
        holed.fitter(search=search).fit(4095 * images(1))


def test_degrees_are_no_radians() -> None:
    viewing = up.inversion.Viewing.of(up.projections.directions(4))
    assert viewing.outside({"angle": torch.tensor([0.5, 3.0])}) == ()
    assert viewing.outside({"angle": torch.tensor([30.0, 3.0])}) == ("angle",)


class Masks(up.projections.Prior):
    """Whole masks as latents, which priors do not draw."""

    names = ("mask",)

    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        return {"mask": torch.rand(n, SIDE, SIDE, generator=rng)}

    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        return torch.ones(len(latents["mask"]), dtype=torch.bool)


class Masked(up.Projection):
    def forward(self, x: Tensor, *, mask: Tensor) -> Tensor:
        return x * mask[:, None]


def test_a_prior_that_draws_more_than_a_number_is_named(tmp_path: Path) -> None:
    panel = up.Panel([up.Observation("masked", Masked(), Masks())], up.Collection(images()))
    with pytest.raises(up.UserError, match=r"the prior of masked draws 'mask' of shape \(2, 32, 32\)"):
        up.train(up.Recipe(GENERATOR, [panel], steps=1, batch=4), tmp_path / "run", quiet=True)


@dataclass(frozen=True)
class Unseen(up.Images):
    def preview(self, x: Tensor) -> Image.Image:
        raise ValueError("no colours")


def test_a_domain_that_cannot_draw_is_told_of_before_anything_is_written(tmp_path: Path) -> None:
    panel = up.Panel([HALF], up.data.observe(images(), [HALF]))
    with pytest.raises(up.UserError, match=r"the domain Unseen fails \(ValueError: no colours\)"):
        up.train(up.Recipe(GENERATOR, [panel], Unseen(), steps=1, batch=4), tmp_path / "run", quiet=True)
    assert not (tmp_path / "run" / "checkpoints").exists()


def test_images_in_colour_are_drawn_and_scored(tmp_path: Path) -> None:
    colours = torch.rand(24, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(0))
    panel = up.Panel([up.Observation("itself", up.Identity())], up.Collection(colours))
    recipe = up.Recipe(functools.partial(GENERATOR, outputs=3), [panel], steps=1, batch=4)
    run = up.train(recipe, tmp_path / "run", quiet=True)
    assert run.sample(2).shape == (2, 3, SIDE, SIDE)
    with Image.open(next((tmp_path / "run" / "samples").iterdir())) as sheet:
        assert sheet.mode == "RGB" and len(np.unique(np.asarray(sheet).std(2))) > 2
    assert {"mmd_rms", "cov_rms", "1nna_rms"} <= run.evaluate(colours, n=8).keys()


def test_samples_of_a_domain_of_ones_own_are_references(tmp_path: Path) -> None:
    class Signals(up.Domain):
        name = "signal"

        def preview(self, x: Tensor) -> Image.Image:
            return Image.new("L", (1, 1))

    x = torch.rand(3, 8)
    Signals().write_arrays(x, tmp_path / "x.npz")
    assert torch.equal(Signals().read(tmp_path / "x.npz", 8).floats(), x)
    with pytest.raises(up.UserError, match=r"give an \.npz of signals"):
        Signals().read(tmp_path, 8)


def test_noise_below_nothing_is_no_offset(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    lines = np.maximum(0, 0.5 - np.abs(np.linspace(-1, 1, 32)))[None] * np.ones((200, 1))
    np.savez(tmp_path / "noisy.npz", lines=lines + 0.05 * rng.standard_normal(lines.shape))
    np.savez(tmp_path / "offset.npz", lines=lines - 0.1)
    with pytest.warns(UserWarning, match="readings scatter below 0"):
        assert scale_of(up.Collection.lines(tmp_path / "noisy.npz")) == 1
    with pytest.raises(up.UserError, match="subtract what is read beside the object"):
        scale_of(up.Collection.lines(tmp_path / "offset.npz"))


def test_twelve_bits_in_sixteen_are_warned_of(tmp_path: Path) -> None:
    for name, most in (("dark", 4095), ("bright", 65535)):
        (tmp_path / name).mkdir()
        values = np.linspace(0, most, 64).astype(np.uint16).reshape(8, 8)
        Image.fromarray(values).save(tmp_path / name / "a.png")
    with pytest.warns(UserWarning, match="no pixel of pictures of 16 bits is over 4095"):
        up.Collection.images(tmp_path / "dark")
    up.Collection.images(tmp_path / "bright")

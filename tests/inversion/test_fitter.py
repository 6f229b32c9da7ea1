"""Fitter: what is behind pictures is found, with its views, and nothing else is changed."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject import UserError
from unproject.inversion import Fitter, LatentSpace, Search, Viewing
from unproject.inversion.fitter import Pictures, State
from unproject.networks import Generator, LowRankGenerator
from unproject.projections import LineIntegral, Observation, Product, Silhouette, Uniform, azimuth_bins, directions

SIDE, BINS = 16, 16


class Seats(Generator):
    """A seat whose width, depth and thickness, and a back whose height, are the code; symmetric about x = 0 only."""

    domain = "volumes"

    def __init__(self) -> None:
        super().__init__(code_size=4)
        self.scale = torch.nn.Parameter(torch.tensor([0.12, 0.12, 0.1, 0.15]))
        self.register_buffer("middle", torch.tensor([0.55, 0.5, 0.2, 0.5]))

    def forward(self, code: Tensor) -> Tensor:
        width, depth, thick, back = (self.middle + self.scale * code).clamp(0.05, 0.9).T[:, :, None, None, None]  # pyright: ignore
        line = (torch.arange(SIDE) + 0.5) * 2 / SIDE - 1
        x, y, z = torch.meshgrid(line, line, line, indexing="ij")

        def inside(distance: Tensor) -> Tensor:
            return torch.sigmoid(20 * distance)

        seat = inside(width - x.abs()) * inside(depth - z.abs()) * inside(thick - (y + 0.2).abs())
        rear = inside(width - x.abs()) * inside(0.1 - (z + depth - 0.1).abs()) * inside(back - (y - 0.2).abs())
        return 1 - (1 - seat) * (1 - rear)


def seats() -> Viewing:
    return Viewing.of(azimuth_bins(BINS, Silhouette(size=SIDE, rule="absorption", density=4.0)))


def one_seat(viewing: Viewing, azimuths: list[float]) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """A seat, its silhouettes, and their views."""
    x = Seats()(torch.tensor([[1.0, -0.8, 0.6, 1.2]])).detach()
    known = {"azimuth": torch.tensor(azimuths)}
    theta = {**known, "elevation": torch.zeros(len(azimuths))}
    return x, viewing.project(x.expand(len(azimuths), -1, -1, -1), theta), known


def test_four_known_views_find_the_sample() -> None:
    viewing = seats()
    x, pictures, known = one_seat(viewing, [0.3, 1.2, 2.5, 4.4])
    found = Fitter(Seats(), viewing, Search(tune=0, candidates=32, starts=2, steps=80, prior=1e-3)).fit(pictures, known)
    assert found.error < 0.01 and (found.x[0] - x[0]).abs().mean() < 0.01
    torch.testing.assert_close(found.theta["azimuth"][0], known["azimuth"])


def test_unknown_views_of_one_thing_are_found_up_to_its_symmetry() -> None:
    viewing = seats()
    _, pictures, known = one_seat(viewing, [0.3, 1.2, 4.4])
    found = Fitter(Seats(), viewing, Search(tune=0, candidates=64, starts=4, steps=60, prior=1e-3)).fit(pictures)
    a = known["azimuth"]
    off = torch.stack([found.theta["azimuth"][0] - a, found.theta["azimuth"][0] - (math.pi - a)])
    assert torch.atan2(off.sin(), off.cos()).abs().amin(0).max() < 0.35
    assert found.error < 0.05


def test_the_posterior_has_both_views_of_a_symmetric_shape() -> None:
    # Of a shape symmetric about x = 0 the level silhouettes at a and at π - a are equal.
    viewing, step = seats(), 2 * math.pi / BINS
    _, pictures, _ = one_seat(viewing, [3 * step])
    found = Fitter(Seats(), viewing, Search(tune=0, candidates=64, starts=1, steps=60, prior=1e-3)).fit(pictures)
    k = round(found.theta["azimuth"][0, 0].item() / step) % BINS
    both = found.posterior[0, [k, (BINS // 2 - k) % BINS]]
    assert both.amin() > 0.1 and both.sum() > 0.8 and found.error < 0.02
    torch.testing.assert_close(found.posterior.sum(), torch.tensor(1.0))


def test_views_are_searched_in_every_bin() -> None:
    viewing, step = seats(), 2 * math.pi / BINS
    x, pictures, _ = one_seat(viewing, [3 * step])
    fitter, of = Fitter(Seats(), viewing), Pictures(pictures, {}, viewing.possible({}, 1))
    wrong = {"azimuth": torch.full((1, 1), 10 * step), "elevation": torch.zeros(1, 1)}
    state = State(torch.zeros(1, 4), torch.full((1, 1), 10), wrong)
    found = fitter._better_viewed(state, x, of, torch.Generator().manual_seed(0))
    assert found.bins.item() in (3, BINS // 2 - 3)
    off = found.theta["azimuth"] - found.bins * step
    assert off.abs() < step / 2 + 1e-6


def test_a_view_outside_of_all_bins_is_no_reason_to_refuse_a_picture() -> None:
    lines = Viewing.of(directions(4, spread=0.1))
    assert lines.possible({"angle": torch.tensor([0.0, 0.4])}, 2).sum(1).tolist() == [1, 4]


class Discs(Generator):
    """Discs whose place and radius are the code."""

    domain = "images"

    def __init__(self) -> None:
        super().__init__(code_size=3)
        self.scale = torch.nn.Parameter(torch.tensor(0.2))

    def forward(self, code: Tensor) -> Tensor:
        line = (torch.arange(SIDE) + 0.5) * 2 / SIDE - 1
        x, y, r = (self.scale * code).T[:, :, None, None]
        off = ((line - x).square() + (line[:, None] - y).square()).sqrt()
        return torch.sigmoid(15 * (0.4 + r - off))[:, None]


@pytest.mark.parametrize("unit", [1.0, 50.0])
def test_distances_have_no_unit(unit: float) -> None:
    class Scaled(LineIntegral):
        def forward(self, x: Tensor, *, angle: Tensor) -> Tensor:
            return unit * super().forward(x, angle=angle)

    viewing = Viewing.of([Observation("line", Scaled(), Uniform("angle", 0, math.pi))])
    x = Discs()(torch.tensor([[1.0, -1.0, 0.5]])).detach()
    known = {"angle": torch.tensor([0.0, 1.0, 2.0])}
    found = Fitter(Discs(), viewing, Search(tune=0, candidates=16, starts=2, steps=60, prior=0.01)).fit(
        viewing.project(x.expand(3, -1, -1, -1), known), known
    )
    assert found.error < 0.01 and (found.x[0] - x[0]).abs().mean() < 0.02
    far = Fitter(Discs(), viewing, Search(tune=0, candidates=64, starts=1, steps=0))
    others = far.candidates.projections
    assert 1 < far.candidates.distance(others, others[:1, 0].expand(1, -1, -1)).mean() < 6


def test_the_prior_keeps_latents_usual() -> None:
    viewing = seats()
    _, pictures, known = one_seat(viewing, [0.3, 1.2])
    size = [
        Fitter(Seats(), viewing, Search(tune=0, candidates=8, starts=1, steps=40, prior=prior))
        .fit(pictures, known)
        .latent
        for prior in (0.0, 30.0)
    ]
    assert size[1].square().mean() < 0.2 * size[0].square().mean()


def test_weights_follow_the_distances_and_the_deviation_is_theirs() -> None:
    viewing = seats()
    _, pictures, _ = one_seat(viewing, [0.3])
    found = Fitter(Seats(), viewing, Search(tune=0, candidates=16, starts=4, steps=5)).fit(pictures)
    assert found.weight.sum().item() == pytest.approx(1) and (found.weight.diff() <= 1e-6).all()
    spread = (found.weight[:, None, None, None] * (found.x - found.mean) ** 2).sum(0).sqrt()
    torch.testing.assert_close(found.deviation, spread)


def test_weights_are_those_before_one_explanation_is_tuned() -> None:
    viewing = seats()
    _, pictures, _ = one_seat(viewing, [0.3])
    plain, tuned = (
        Fitter(Seats(), viewing, Search(tune=n, candidates=16, starts=4, steps=5, tune_rate=1e-2)).fit(pictures)
        for n in (0, 30)
    )
    assert tuned.error < 0.9 * plain.error and plain.weight.max() < 0.99
    torch.testing.assert_close(tuned.weight, plain.weight)
    torch.testing.assert_close(tuned.posterior, plain.posterior)
    assert tuned.deviation.square().mean() > 0.1 * plain.deviation.square().mean()


def test_tuning_changes_a_copy_of_the_generator() -> None:
    torch.manual_seed(0)
    generator, viewing = Seats(), seats()
    _, pictures, known = one_seat(viewing, [0.3, 1.2])
    before = generator.scale.detach().clone()
    plain, tuned = (
        Fitter(generator, viewing, Search(candidates=8, starts=2, steps=3, tune=n, tune_rate=1e-2)).fit(pictures, known)
        for n in (0, 30)
    )
    assert torch.equal(generator.scale, before) and generator.scale.requires_grad
    assert tuned.error < 0.9 * plain.error
    torch.testing.assert_close(tuned.x[1], plain.x[1])


def test_a_generator_that_tuning_spoils_is_left_as_it_is() -> None:
    torch.manual_seed(0)
    generator, viewing = Seats(), seats()
    _, pictures, known = one_seat(viewing, [0.3, 1.2])
    before = generator.scale.detach().clone()
    plain, tuned = (
        Fitter(generator, viewing, Search(candidates=8, starts=2, steps=3, tune=n, tune_rate=10.0)).fit(pictures, known)
        for n in (0, 30)
    )
    assert torch.equal(generator.scale, before) and generator.scale.requires_grad
    assert tuned.error <= plain.error
    torch.testing.assert_close(tuned.x, plain.x)


def test_the_same_seed_finds_the_same() -> None:
    viewing = seats()
    _, pictures, _ = one_seat(viewing, [0.3])
    a, b = (
        Fitter(Seats(), viewing, Search(tune=0, candidates=8, starts=2, steps=5), seed=3).fit(pictures)
        for _ in range(2)
    )
    assert torch.equal(a.x, b.x) and torch.equal(a.posterior, b.posterior)


def test_latents_are_white() -> None:
    torch.manual_seed(0)
    generator = LowRankGenerator(size=16, code_size=8, channels=8, rank=4).eval()
    space = LatentSpace.of(generator)
    v = space.whitened(generator.map_code(torch.randn(4000, 8))).detach()
    v = v[:, :32]  # the last ones are hardly there, with deviations that few codes decide
    torch.testing.assert_close(v.mean(0), torch.zeros(32), atol=0.1, rtol=0)
    torch.testing.assert_close(v.T @ v / len(v), torch.eye(32), atol=0.15, rtol=0)
    code = torch.randn(3, 8)
    torch.testing.assert_close(generator.synthesise(generator.map_code(code)), generator(code))


def test_pictures_of_another_size_and_settings_out_of_range_are_refused() -> None:
    fitter = Fitter(Seats(), seats(), Search(tune=0, candidates=2, starts=1, steps=1))
    with pytest.raises(UserError, match="as in training"):
        fitter.fit(torch.rand(1, 1, 8, 8))
    with pytest.raises(UserError, match="as in training"):
        fitter.fit(torch.rand(0, 1, SIDE, SIDE))
    for wrong in ({"starts": 9, "candidates": 8}, {"steps": -1}, {"rate": 0.0}, {"prior": math.nan}):
        with pytest.raises(UserError):
            Search(**wrong)  # type: ignore[arg-type]


def test_a_known_latent_outside_of_all_bins_leaves_the_others_known() -> None:
    level = Viewing.of(azimuth_bins(8, Silhouette(size=16)))
    known = {"azimuth": torch.tensor([math.pi / 2, math.pi / 2]), "elevation": torch.tensor([0.0, 0.2])}
    possible = level.possible(known, 2)
    assert possible.sum(1).tolist() == [1, 1] and possible.int().argmax(1).tolist() == [2, 2]


def test_one_projection_has_no_variance() -> None:
    one = Viewing.of(
        [Observation("only", Silhouette(size=16), Product(*(Uniform(a, 0, 0) for a in ("azimuth", "elevation"))))]
    )
    with pytest.raises(UserError, match="candidates=1: give at least 2"):
        Fitter(Seats(), one, Search(tune=0, candidates=1, starts=1)).fit(torch.zeros(1, 1, 16, 16))


def test_a_rate_that_leaves_nothing_finite_is_one_line() -> None:
    viewing = seats()
    _, pictures, _ = one_seat(viewing, [0.3, 1.2])
    with pytest.raises(UserError, match="nothing that was found at a rate of 1e[+]30 is finite; give a lower --rate"):
        Fitter(Seats(), viewing, Search(tune=0, candidates=8, starts=2, steps=3, rate=1e30)).fit(pictures)

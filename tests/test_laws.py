"""Every shipped part obeys the laws, and every law catches the mutant that breaks it."""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from unproject._random import generator_at, seeded
from unproject._types import UserError
from unproject.ops import absorption, expected_depth, rotate_y
from unproject.ops.maps import MAPS, MapName
from unproject.ops.microfacet import Reflection
from unproject.ops.shading import Sampling
from unproject.projections.base import Identity, Projection
from unproject.projections.line_integral import LineIntegral, directions
from unproject.projections.observation import Observation
from unproject.projections.priors import Bins, Cap, Empirical, Mixture, Prior, Product, Uniform
from unproject.projections.rendering import Rendering, rendering_prior
from unproject.projections.selection import Selection
from unproject.projections.silhouette import CAMERAS, RULES, Silhouette, azimuth_bins, azimuth_elevation_bins
from unproject.testing import (
    GENERATOR_LAWS,
    PRIOR_LAWS,
    PROJECTION_LAWS,
    LawError,
    check_generator,
    check_prior,
    check_projection,
    run_laws,
)


def broken(part: object) -> list[str]:
    return [result.name for result in run_laws(part) if not result.passed]


# Shipped parts

ANYWHERE = Product(Uniform("azimuth", 0, 6.28), Uniform("elevation", -1.5, 1.5))
LEVEL = Product(Uniform("azimuth", 0, 6.28), Uniform("elevation", 0, 0))
SILHOUETTES = {
    f"{rule}-{camera}-{name}": Observation("look", Silhouette(rule=rule, camera=camera, **options), prior)
    for rule in RULES
    for camera in CAMERAS
    for name, options, prior in (
        ("anywhere", {}, ANYWHERE),
        ("level", {}, LEVEL),
        ("framed", {"size": 5, "viewport": 1.4, "depth_samples": 7}, LEVEL),
    )
}
PRIORS = {
    "uniform": Uniform("angle", -1, 2),
    "exact": Uniform("angle", 0.1, 0.1),
    "periodic": Uniform("angle", -0.2, 0.2, 2 * math.pi),
    "bins": Bins("angle", 16),
    "bin": Bins("angle", 16).parts[9],
    "product": ANYWHERE,
    "nothing": Product(),
    "mixture": Mixture([Uniform("angle", 0, 1), Uniform("angle", 3, 4)], [1, 3]),
    "empirical": Empirical({"azimuth": torch.tensor([0.1, 0.2, 3.0]), "elevation": torch.zeros(3)}),
    "mixture of products": Mixture([Product(Uniform("azimuth", a, a), Uniform("elevation", 0, 0)) for a in (0, 1.5)]),
    "azimuth-elevation": azimuth_elevation_bins()[23].prior,
    "cap": Cap("light", "light_azimuth", 1.2),
    "pole": Cap("light", "light_azimuth", 0.0),
    "lamp": rendering_prior(Rendering("coloured"), 0.0, 0.8, light_azimuth=3.0),
    "photograph": rendering_prior(Rendering(torch.rand(2, 3, 8, 16, generator=generator_at(0))), 1.4),
}
PROBES = torch.rand(2, 3, 8, 16, generator=generator_at(0), dtype=torch.float64)
RENDERINGS = {
    f"{name}-{fresnel}-{space}-{'developed' if developed else 'linear'}": Rendering(
        lighting,
        Reflection(fresnel, shadowing=shadowing),  # pyright: ignore[reportArgumentType]
        Sampling(8),
        space=space,  # pyright: ignore[reportArgumentType]
        developed=developed,
    )
    for name, lighting in (*((name, name) for name in ("ambient", "directional", "coloured")), ("natural", PROBES))
    for fresnel, shadowing, space, developed in (
        ("eta", "smith", "texture", True),
        ("albedo", "smith", "texture", False),
        ("eta", "cook-torrance", "image", False),
    )
}


class Materials:
    """Maps as materials have them: normals out of the surface, a roughness that is not 0."""

    @staticmethod
    def example() -> Tensor:
        x = 0.1 + 0.6 * torch.rand(3, 8, 4, 4, generator=generator_at(3))
        x[:, 5:7] = x[:, 5:7] - 0.4
        x[:, 7] = 0.9
        return x

    @staticmethod
    def coloured() -> Tensor:
        """The same with three specular channels."""
        x = Materials.example()
        return torch.cat([x[:, :4], x[:, 3:4].flip(2), x[:, 3:4].flip(3), x[:, 4:]], 1)


class ExpectedDepth(Projection):
    """The example of the documentation."""

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return expected_depth(rotate_y(x, azimuth))


@pytest.mark.parametrize("name", SILHOUETTES)
def test_silhouettes_obey_the_laws(name: str) -> None:
    check_projection(SILHOUETTES[name])


@pytest.mark.parametrize(
    "part", [Identity(), ExpectedDepth(), azimuth_bins()[3], directions()[4]], ids=lambda p: type(p).__name__
)
def test_other_projections_obey_the_laws(part: Projection | Observation) -> None:
    check_projection(part)


@pytest.mark.parametrize("options", [{}, {"bins": 5}, {"bins": 13}, {"fast": False}], ids=str)
def test_line_integrals_obey_the_laws(options: dict[str, Any]) -> None:
    check_projection(Observation("around", LineIntegral(**options), Uniform("angle", 0, 7)))


@pytest.mark.parametrize("name", MAPS)
def test_selections_obey_the_laws(name: MapName) -> None:
    check_projection(Observation(name, Selection(name)))


@pytest.mark.parametrize("name", RENDERINGS)
def test_renderings_obey_the_laws(name: str) -> None:
    look = RENDERINGS[name]
    prior = rendering_prior(look, 0.7, spread=0.6)
    check_projection(Observation(name, look, prior), Materials.example())


@pytest.mark.parametrize("name", [name for name in RENDERINGS if "texture" in name])
def test_renderings_of_coloured_specular_albedos_obey_the_laws(name: str) -> None:
    look = RENDERINGS[name]
    check_projection(Observation(name, look, rendering_prior(look, 0.7, spread=0.6)), Materials.coloured())


@pytest.mark.parametrize("name", MAPS)
def test_selections_of_coloured_specular_albedos_obey_the_laws(name: MapName) -> None:
    check_projection(Observation(name, Selection(name)), Materials.coloured())


@pytest.mark.parametrize("name", PRIORS)
def test_priors_obey_the_laws(name: str) -> None:
    check_prior(PRIORS[name])


# Mutants of projections


class Honest(Projection):
    """Sums along z, turned into an absorption: what the mutants spoil."""

    example_shape = (4, 4, 4)

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return absorption(x) * (1 + azimuth.view(-1, 1, 1)).cos()


class Summed(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return super().forward(x, azimuth=azimuth).sum(0, keepdim=True)


class SinglePrecision(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return super().forward(x, azimuth=azimuth).float()


class Noisy(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return super().forward(x, azimuth=azimuth) + 1e-3 * torch.rand(())


class PythonNoisy(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return super().forward(x, azimuth=azimuth) + 1e-3 * random.random()


class TurnsItsInput(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        y = super().forward(x, azimuth=azimuth)
        azimuth.add_(1)
        return y


class ErasesItsInput(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        y = super().forward(x, azimuth=azimuth)
        x.detach().zero_()
        return y


class Remembers(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        self.last = azimuth.clone()
        self.calls = getattr(self, "calls", 0) + 1
        return super().forward(x, azimuth=azimuth)


class Centred(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        y = super().forward(x, azimuth=azimuth)
        return y - y.mean(0, keepdim=True)


class Counted(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return super().forward(x, azimuth=azimuth) + torch.arange(len(x)).to(x).view(-1, 1, 1)


class Ordered(Honest):
    """Right for each element alone and in the example, wrong in the reversed batch."""

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return super().forward(x, azimuth=azimuth) + (azimuth[0] > azimuth[-1]).to(x)


class DividesByNothing(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return super().forward(x, azimuth=azimuth) / x.sum((1, 2, 3)).view(-1, 1, 1)


class LogarithmOfNothing(Honest):
    """1 - exp(Σ log(1 - p)) is finite at p = 1, its gradient is not."""

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return 1 - (1 - x).log().sum(-1).exp() + 0 * azimuth.view(-1, 1, 1)


class Detached(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return x.mean(-1) * super().forward(x.detach(), azimuth=azimuth)


class Rounded(Honest):
    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return x.round().sum(-1) * (x * 0 + 1).sum(-1)


class HalfDetached(Honest):
    """The derivative by θ lacks a part: one of the two places that θ has is detached."""

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        turned = azimuth.view(-1, 1, 1)
        return absorption(x) * turned.cos() * turned.detach().sin()


class Affine(Honest):
    linear = True

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return x.sum(-1) + 1


class WrongAdjoint(Honest):
    linear = True

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return x.cumsum(-1)

    def adjoint(self, y: Tensor, *, azimuth: Tensor) -> Tensor:
        return y.cumsum(-1)


class RightAdjoint(WrongAdjoint):
    def adjoint(self, y: Tensor, *, azimuth: Tensor) -> Tensor:
        return y.flip(-1).cumsum(-1).flip(-1)


PROJECTION_MUTANTS = [
    (Summed, "shape"),
    (SinglePrecision, "dtype"),
    (Noisy, "pure"),
    (PythonNoisy, "pure"),
    (TurnsItsInput, "inputs"),
    (ErasesItsInput, "inputs"),
    (Remembers, "state"),
    (Centred, "batched"),
    (Counted, "batched"),
    (Ordered, "batched"),
    (DividesByNothing, "finite"),
    (LogarithmOfNothing, "finite"),
    (Detached, "differentiable"),
    (Rounded, "differentiable"),
    (HalfDetached, "latents"),
    (Affine, "superposition"),
    (WrongAdjoint, "adjoint"),
]


@pytest.mark.parametrize("mutant, law", PROJECTION_MUTANTS)
def test_precisely_that_law_catches_the_projection(mutant: type[Projection], law: str) -> None:
    assert broken(mutant()) == [law]


def test_every_projection_law_has_a_mutant() -> None:
    assert {law for _, law in PROJECTION_MUTANTS} == {law.name for law in PROJECTION_LAWS}


@pytest.mark.parametrize("part", [Honest(), RightAdjoint()])
def test_what_the_mutants_spoil_is_right(part: Projection) -> None:
    check_projection(part)


def test_the_error_names_law_measurement_and_cause() -> None:
    with pytest.raises(LawError, match=r"(?s)Noisy breaks 1 of 11 laws.*- pure: .*differ by \d.*Likely cause: .*prior"):
        check_projection(Noisy())


def test_a_projection_that_raises_breaks_a_law_and_no_more() -> None:
    class Raises(Honest):
        def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
            raise RuntimeError("the scanner is switched off")

    (result,) = run_laws(Raises())
    assert not result.passed and "RuntimeError: the scanner is switched off" in result.detail


def test_an_example_of_the_users_is_used() -> None:
    seen = []

    class Peeks(Honest):
        def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
            seen.append(tuple(x.shape[1:]))
            return super().forward(x, azimuth=azimuth)

    check_projection(Peeks(), example=torch.rand(2, 3, 5, 2))
    assert set(seen) == {(3, 5, 2)}


def test_an_example_of_one_tells_what_is_mixed_with_the_batch() -> None:
    class Mean(Projection):
        def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
            return x.sum(3) / x.mean()

    with pytest.raises(LawError, match="batched"):
        check_projection(Mean(), example=torch.rand(1, 4, 4, 4))


class Thrice(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        return 1e-5 * x

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        return 3e-5 * gradient


def test_gradients_of_small_values_are_compared_too() -> None:
    class Faint(Projection):
        def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
            y: Tensor = Thrice.apply(x)  # pyright: ignore[reportAssignmentType]
            return y.sum(3)

    with pytest.raises(LawError, match="differentiable"):
        check_projection(Faint())


# Mutants of priors


class Misnamed(Uniform):
    @property
    def names(self) -> tuple[str, ...]:
        return ("azimut",)


class Column(Uniform):
    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        return {self.name: super().sample(n, rng)[self.name][:, None]}


class DoublePrecision(Uniform):
    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        return {self.name: super().sample(n, rng)[self.name].double()}


class Infinite(Uniform):
    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        return {self.name: 1 / (super().sample(n, rng)[self.name] * 8).floor()}

    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        return latents[self.name] >= 0


class Global(Uniform):
    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        return {self.name: torch.rand(n)}


class Narrow(Uniform):
    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        return latents[self.name] < 0.5


class Whole(Uniform):
    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        return torch.tensor(True)


PRIOR_MUTANTS = [
    (Misnamed, "names"),
    (Column, "shape"),
    (DoublePrecision, "dtype"),
    (Infinite, "finite"),
    (Global, "deterministic"),
    (Narrow, "support"),
    (Whole, "support"),
]


@pytest.mark.parametrize("mutant, law", PRIOR_MUTANTS)
def test_precisely_that_law_catches_the_prior(mutant: type[Uniform], law: str) -> None:
    prior: Prior = mutant("azimuth", 0, 1)
    assert broken(prior) == [law]
    with pytest.raises(LawError, match=law):
        check_prior(prior)


def test_every_prior_law_has_a_mutant() -> None:
    assert {law for _, law in PRIOR_MUTANTS} == {law.name for law in PRIOR_LAWS}


def test_an_observation_is_checked_with_its_prior() -> None:
    observation = Observation("look", Noisy(), Narrow("azimuth", 0, 1))
    assert broken(observation) == ["support", "pure"]


# Mutants of generators


class Dense(nn.Module):
    """Two layers with batch norm: what the mutants spoil."""

    def __init__(self) -> None:
        super().__init__()
        with seeded(0, "dense"):
            self.first, self.norm, self.last = nn.Linear(5, 8), nn.BatchNorm1d(8), nn.Linear(8, 27)

    def forward(self, code: Tensor) -> Tensor:
        return self.logits(code).sigmoid().view(-1, 3, 3, 3)

    def logits(self, code: Tensor) -> Tensor:
        return self.last(self.norm(self.first(code)).relu())

    def draw(self, n: int, rng: torch.Generator) -> Tensor:
        return torch.randn(n, 5, generator=rng)

    @torch.no_grad()
    def sample(self, n: int, seed: int = 0) -> Tensor:
        return self(torch.cat([self.draw(1, generator_at(seed, i)) for i in range(n)]))


class OneForAll(Dense):
    def forward(self, code: Tensor) -> Tensor:
        return super().forward(code).mean(0, keepdim=True)


class Overflowing(Dense):
    def forward(self, code: Tensor) -> Tensor:
        # Finite for ordinary codes, infinite for extreme ones.
        return super().forward(code) * (0 * (40 * code.abs().amax(1)).exp() + 1).view(-1, 1, 1, 1)


class Unbounded(Dense):
    def forward(self, code: Tensor) -> Tensor:
        return self.logits(code).view(-1, 3, 3, 3)


class DropsOut(Dense):
    def forward(self, code: Tensor) -> Tensor:
        return super().forward(code) * torch.rand(())

    def sample(self, n: int, seed: int = 0) -> Tensor:
        with seeded(seed):
            return super().sample(n, seed)


class WritesBuffers(Dense):
    def forward(self, code: Tensor) -> Tensor:
        if len(code) > 1:
            self.norm.num_batches_tracked.add_(1)  # pyright: ignore[reportOptionalMemberAccess]
        return super().forward(code)


class BatchStatistics(Dense):
    def forward(self, code: Tensor) -> Tensor:
        return super().forward(code - 0.5 * code.mean(0))

    @torch.no_grad()
    def sample(self, n: int, seed: int = 0) -> Tensor:
        return torch.cat([self(self.draw(1, generator_at(seed, i))) for i in range(n)])


class Unseeded(Dense):
    @torch.no_grad()
    def sample(self, n: int, seed: int = 0) -> Tensor:
        return self(torch.randn(n, 5))


class SameForAllSeeds(Dense):
    def sample(self, n: int, seed: int = 0) -> Tensor:
        return super().sample(n, 0)


class Untrained(Dense):
    def __init__(self) -> None:
        super().__init__()
        self.unused = nn.Linear(2, 2)


GENERATOR_MUTANTS = [
    (OneForAll, "shape"),
    (Overflowing, "finite"),
    (Unbounded, "range"),
    (DropsOut, "pure"),
    (WritesBuffers, "pure"),
    (BatchStatistics, "alone"),
    (Unseeded, "seeded"),
    (SameForAllSeeds, "seeded"),
    (Untrained, "trainable"),
]


@pytest.mark.parametrize("mutant, law", GENERATOR_MUTANTS)
def test_precisely_that_law_catches_the_generator(mutant: type[nn.Module], law: str) -> None:
    assert broken(mutant()) == [law]


def test_every_generator_law_has_a_mutant() -> None:
    assert {law for _, law in GENERATOR_MUTANTS} == {law.name for law in GENERATOR_LAWS}


def test_checking_a_generator_leaves_it_as_it_was() -> None:
    generator = Dense().train()
    before = {k: v.clone() for k, v in generator.state_dict().items()}
    check_generator(generator)
    assert generator.training
    assert all(torch.equal(v, before[k]) for k, v in generator.state_dict().items())


def test_a_generator_of_another_range() -> None:
    check_generator(Unbounded(), low=-100, high=100)


def test_laws_want_a_part() -> None:
    with pytest.raises(UserError, match="give one of these"):
        run_laws(3)


def test_checks_leave_global_randomness_alone() -> None:
    torch.manual_seed(3)
    random.seed(3)
    before = torch.get_rng_state(), random.getstate()
    check_projection(Honest())
    assert torch.equal(torch.get_rng_state(), before[0]) and random.getstate() == before[1]


def test_the_prior_of_an_observation_is_tested_too() -> None:
    class Elsewhere(Uniform):
        def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
            return latents["angle"] > 3

    with pytest.raises(LawError, match="Elsewhere breaks 1 of 6 laws tried"):
        check_projection(Observation("around", LineIntegral(), Elsewhere("angle", 0, 7)))


def test_a_class_is_tested_as_an_object_of_it_and_what_raises_says_what_it_was_given() -> None:
    check_projection(LineIntegral)

    class OfOneSize(Honest):
        def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
            return x.view(len(x), 32, 32)

    with pytest.raises(LawError, match=r"given x \(3, 4, 4, 4\) of float64 \(an operator of one size alone names it"):
        check_projection(OfOneSize)

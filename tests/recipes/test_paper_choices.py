"""What the seed and the released code choose, one by one: `-paper` recipes keep it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch.nn.utils.parametrize import is_parametrized

from unproject.adversarial.losses import Hinge, Logistic, Wasserstein
from unproject.adversarial.penalties import GradientPenalty
from unproject.assignment import Known, LearnedPrior, Predicted, Unassigned
from unproject.networks import Discriminator, ImageGenerator, ViewPredictor, VoxelGenerator
from unproject.networks.discriminators import SpectralNorm
from unproject.recipes import shape_panels
from unproject.recipes.digits import digits_paper
from unproject.recipes.materials import metal_paper, plastic_paper, wood_paper
from unproject.recipes.shapes import shapes_paper
from unproject.training import Adam, Recipe

FEW: dict[Callable[..., Recipe], dict[str, Any]] = {
    shapes_paper: {"views_per_shape": 1},
    digits_paper: {},
    wood_paper: {"maps": 2, "renderings": 2},
}


@pytest.fixture(autouse=True)
def few_chairs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shape_panels, "PROCEDURAL_CHAIRS", 4)


def made(function: Callable[..., Recipe], **flags: Any) -> Recipe:
    return function(**{**FEW[function], **flags})


# Parts I and III


@pytest.mark.parametrize("function", [shapes_paper, digits_paper])
def test_wgan_gp_with_the_released_rates(function: Callable[..., Recipe]) -> None:
    recipe = made(function)
    assert recipe.loss == Wasserstein() and recipe.penalty == GradientPenalty(10.0, every=1)
    assert (
        recipe.generator_optimiser == recipe.discriminator_optimiser == Adam(1e-4, beta1=0.5, beta2=0.999, final=None)
    )
    assert recipe.discriminator_steps == 2 and recipe.views_per_sample == 1 and recipe.balance_every == 0
    assert recipe.augmentation is None and recipe.regulariser is None and recipe.precision == "float32"


@pytest.mark.parametrize("binary", [True, False])
def test_rendered_silhouettes_are_soft_unless_asked_for(binary: bool) -> None:
    images = made(shapes_paper, size=16, **({"binary": True} if binary else {})).panels[0].collections[0].floats()
    assert bool(((images == 0) | (images == 1)).all()) == binary


def test_the_hinge_loss_has_no_gradient_penalty() -> None:
    recipe = made(shapes_paper, loss="hinge")
    assert recipe.loss == Hinge() and recipe.penalty is None


def test_budgets_and_batches() -> None:
    assert (made(shapes_paper).steps, made(shapes_paper).batch) == (5 * 60_000, 32)
    assert (made(digits_paper).steps, made(digits_paper).batch) == (100_000, 64)


def test_the_generator_of_shapes_is_a_full_one_of_512_channels() -> None:
    generator = made(shapes_paper).generator()
    assert isinstance(generator, VoxelGenerator)
    with torch.no_grad():
        assert generator.eval()(torch.zeros(1, generator.code_size)).shape == (1, 64, 64, 64)
    first = next(module for module in generator.modules() if isinstance(module, nn.Linear))
    assert first.out_features == 512 * 4**3 and generator.truncation is None
    assert any(isinstance(module, nn.BatchNorm3d) for module in generator.modules())


def test_the_generator_of_images_has_512_channels() -> None:
    generator = made(digits_paper).generator()
    assert isinstance(generator, ImageGenerator)
    first = next(module for module in generator.modules() if isinstance(module, nn.Linear))
    assert first.out_features == 512 * 4**2


@pytest.mark.parametrize("function", [shapes_paper, digits_paper])
def test_discriminators_have_spectral_norm_in_every_layer(function: Callable[..., Recipe]) -> None:
    recipe = made(function)
    (panel,) = recipe.panels
    discriminator = recipe.discriminator(panel.shape, 3)
    assert isinstance(discriminator, Discriminator) and discriminator.slope == 0.1
    layers = [m for m in discriminator.modules() if "weight" in dict(m.named_parameters()) or is_parametrized(m)]
    layers = [m for m in layers if not isinstance(m, nn.ModuleList)]
    norms = [m for m in discriminator.modules() if isinstance(m, SpectralNorm)]
    assert len(layers) == len(norms) == 5 and all(is_parametrized(m, "weight") for m in layers)
    assert len(discriminator.shared) == 2 and len(discriminator.own) == 2  # the first layers are shared
    first = discriminator.shared[0]
    assert first.weight.shape[0] == 64


def test_five_rounds_of_most_probable_views_with_a_fresh_predictor() -> None:
    assignment = made(shapes_paper).panels[0].assignment
    assert isinstance(assignment, Predicted) and assignment.initialiser is None
    rounds, fit, estimator = assignment.rounds, assignment.fit, assignment.estimator
    assert rounds.starts == (0.2, 0.4, 0.6, 0.8) and rounds.restart and rounds.least_steps == 0
    assert (fit.steps, fit.images, fit.batch, fit.learning_rate) == (100_000, 65_536, 32, 1e-3)
    assert fit.binarise and fit.fresh
    assert (estimator.draw, estimator.balance, estimator.window, estimator.clusters) == ("argmax", 0.0, None, None)
    predictor = fit.network((1, 64, 64), 16)
    assert isinstance(predictor, ViewPredictor) and predictor.layers[0].weight.shape[0] == 32
    assert any(isinstance(module, nn.BatchNorm2d) for module in predictor.modules())


def test_digits_predict_directions_likewise() -> None:
    assignment = made(digits_paper, views="predicted").panels[0].assignment
    assert isinstance(assignment, Predicted) and not assignment.fit.binarise and assignment.fit.fresh
    assert (assignment.fit.steps, assignment.fit.images) == (100_000, 65_536)
    assert assignment.rounds.restart and len(made(digits_paper, views="predicted").panels[0].observations) == 10


def test_clusters_are_the_released_codes_eight() -> None:
    assignment = made(shapes_paper, clusters=8).panels[0].assignment
    assert isinstance(assignment, Predicted) and assignment.heads(made(shapes_paper).panels[0]) == 8


@pytest.mark.parametrize(
    "views, kind, heads",
    [("predicted", Predicted, 16), ("learned", LearnedPrior, 1), ("known", Known, 16), ("single", Unassigned, 1)],
)
def test_sixteen_views_and_a_head_each_where_views_are_assigned(views: str, kind: type, heads: int) -> None:
    (panel,) = made(shapes_paper, views=views, views_per_shape=64).panels
    assert len(panel.observations) == 16 and isinstance(panel.assignment, kind)
    assert panel.assignment.heads(panel) == heads and (panel.weight, panel.penalty_scale) == (1.0, 1.0)


def test_the_released_camera_and_alpha_rule() -> None:
    projection: Any = made(shapes_paper, released=True).panels[0].observations[0].projection
    assert (projection.rule, projection.viewport) == ("alpha", 1.4)
    plain: Any = made(shapes_paper).panels[0].observations[0].projection
    assert (plain.rule, plain.viewport) == ("any", 1.0)
    generator = made(shapes_paper, released=True).generator()
    assert generator.truncation == 0.75


# Part II


@pytest.mark.parametrize("function", [wood_paper, metal_paper, plastic_paper])
def test_materials_use_dcgans_loss_one_to_one(function: Callable[..., Recipe]) -> None:
    recipe = function(maps=2, renderings=2)
    assert recipe.loss == Logistic() and recipe.penalty is None and recipe.discriminator_steps == 1
    assert recipe.generator_optimiser == recipe.discriminator_optimiser == Adam(1e-4, beta1=0.5, beta2=0.9, final=None)
    assert (recipe.steps, recipe.batch, recipe.balance_every) == (50_000, 64, 0)
    names = [panel.observations[0].name for panel in recipe.panels]
    assert names == ["diffuse", "specular", "roughness", "normal", "top", "grazing"]
    assert all((panel.weight, panel.penalty_scale) == (1.0, 1.0) for panel in recipe.panels)


def test_the_generator_of_materials_is_dcgan_with_a_uniform_code_of_512() -> None:
    generator = made(wood_paper).generator()
    codes = generator.draw(4000, torch.Generator().manual_seed(0))
    assert codes.shape == (4000, 512) and codes.abs().max() <= 1 and codes.std() == pytest.approx(3**-0.5, rel=0.01)
    linear = [module for module in generator.modules() if isinstance(module, nn.Linear)]
    assert max(module.out_features for module in linear) == 512 * 4**2


def test_discriminators_of_materials_are_given_their_group_by_the_training() -> None:
    recipe = made(wood_paper, batch=6)
    discriminator: Any = recipe.discriminator((3, 64, 64), 1)
    assert recipe.batch == 6 and discriminator.group is None
    convolution = next(module for module in discriminator.modules() if isinstance(module, nn.Conv2d))
    assert convolution.out_channels == 64


def test_as_many_images_for_one_discriminator_of_all_maps() -> None:
    (panel,) = wood_paper(views="direct", maps=8, renderings=4, samples=2).panels
    assert len(panel) == (4 * 8 + 2 * 4) // 4 and panel.shape == (8, 64, 64)


def logits(discriminator: nn.Module, images: Tensor) -> Tensor:
    return discriminator(images, torch.zeros(len(images), dtype=torch.long))


def test_logits_are_not_squashed() -> None:
    """The loss has the sigmoid: a discriminator that had one too could not exceed 1."""
    recipe = made(digits_paper)
    discriminator = recipe.discriminator((1, 32), 1)
    found = logits(discriminator, 1e4 * torch.rand(8, 1, 32, generator=torch.Generator().manual_seed(0)))
    assert found.abs().max() > 1

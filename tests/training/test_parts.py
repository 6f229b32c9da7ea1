"""A user's own parts: what does not fit is told before anything is written, what draws repeats, what loads is equal."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

import unproject as up
from unproject.training import Recipe, load, resume, train
from unproject.training.parts import check_parts
from unproject.training.state import State

SIZE = 16


class Largest(up.Projection):
    """The largest value along rays."""

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return up.ops.rotate_y(x, azimuth).amax(3).transpose(1, 2).flip(1)[:, None]


class Linear(up.Generator):
    domain = "volumes"

    def __init__(self, levels: Any = None, activation: type[nn.Module] = nn.Identity, dropout: float = 0.0) -> None:
        super().__init__(code_size=4)
        self.scale = 1.0 if levels is None else float(len(levels))
        self.layers = nn.Sequential(nn.Linear(4, SIZE**3), activation(), nn.Dropout(dropout))

    def forward(self, code: Tensor) -> Tensor:
        return (self.scale * self.layers(code)).view(-1, SIZE, SIZE, SIZE).sigmoid()


class Judge(nn.Module):
    def __init__(self, shape: tuple[int, ...], heads: int, dropout: float = 0.0) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Flatten(), nn.Linear(math.prod(shape), 8), nn.Dropout(dropout), nn.ReLU())
        self.heads = nn.Linear(8, heads)

    def forward(self, y: Tensor, head: Tensor) -> Tensor:
        return self.heads(self.layers(y)).gather(1, head[:, None])[:, 0]


class All(Judge):
    def forward(self, y: Tensor, head: Tensor) -> Tensor:
        return self.heads(self.layers(y))


class Unreduced(up.Loss):
    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        return fake - real

    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        return -fake


OBSERVATION = up.Observation("mip", Largest(), up.Uniform("azimuth", 0, 2 * math.pi))
DATA = up.data.observe(up.data.chairs(6, SIZE).float(), [OBSERVATION])


def recipe(**changes: Any) -> Recipe:
    given: dict[str, Any] = {"generator": Linear, "discriminator": Judge, "batch": 4, "steps": 4, "checkpoint_every": 2}
    return Recipe(**{**given, "panels": [up.Panel([OBSERVATION], changes.pop("data", DATA))], **changes})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"discriminator": All}, r"All of panel 'mip' returns \(2, 1\) for 2 images; it is called as"),
        ({"discriminator": lambda shape: Judge(shape, 1)}, r"discriminator: called with \(shape of one image, number"),
        ({"generator": partial(up.networks.LowRankGenerator, size=32)}, r"makes \(1, 32, 32\) of .* data are \(1, 1"),
        ({"generator": lambda: nn.Linear(2, 2)}, "made a Linear; make a subclass of up.Generator"),
        ({"data": up.Collection(DATA.floats()[:, 0])}, r"makes \(1, 16, 16\) of .* and the data are \(16, 16\)"),
        ({"loss": Unreduced()}, r"the discriminator's loss of Unreduced returns \(2,\); it is to be one number"),
        ({"regulariser": lambda x: x.mean()}, r"regulariser function fails \(TypeError: .*regulariser\(x, progress\)"),
    ],
)
def test_what_does_not_fit_is_told_before_anything_is_written(
    tmp_path: Path, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(up.UserError, match=said):
        train(recipe(**changes), tmp_path / "run", quiet=True)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: recipe(generator=Linear()), "generator: is built for each run anew; give the class"),
        (lambda: recipe(loss="hinge"), "loss='hinge': give a Loss"),
        (lambda: Recipe(Linear, up.Panel([OBSERVATION], DATA), steps=1), "give a list of panels"),  # type: ignore[arg-type]
        (lambda: Recipe(Linear, [up.Panel([OBSERVATION], DATA)], Linear, steps=1), "give a Domain"),  # type: ignore[arg-type]
        (lambda: up.Panel(OBSERVATION, DATA), "give a list of observations"),  # type: ignore[arg-type]
        (lambda: up.Panel([OBSERVATION], DATA.floats()), r"its data are a Tensor; give up.Collection"),  # type: ignore[arg-type]
        (lambda: up.Panel([OBSERVATION], DATA.floats().numpy()), "its data are a ndarray; give up.Collection"),  # type: ignore[arg-type]
    ],
)
def test_a_part_of_the_wrong_kind_is_told_at_once(made: Any, said: str) -> None:
    with pytest.raises(up.UserError, match=said):
        made()


def test_trying_the_parts_changes_nothing() -> None:
    """Neither statistics of batches nor vectors of spectral norms nor the global state."""

    class Normed(Judge):
        def __init__(self, shape: tuple[int, ...], heads: int) -> None:
            super().__init__(shape, heads)
            self.layers.append(nn.BatchNorm1d(8))
            self.layers.append(torch.nn.utils.parametrizations.spectral_norm(nn.Linear(8, 8)))

    made = recipe(discriminator=Normed, generator=partial(Linear, dropout=0.5))
    state = State(made, torch.device("cpu"))
    before, random = state.tensors(), torch.random.get_rng_state()
    check_parts(made, state)
    after = state.tensors()
    assert all(torch.equal(value, after[name]) for name, value in before.items())
    assert torch.equal(random, torch.random.get_rng_state())


def test_layers_that_draw_repeat_and_resume(tmp_path: Path) -> None:
    """Dropout of both networks: two runs are equal, and one that was stopped half way; the user's state is kept."""
    made = recipe(generator=partial(Linear, dropout=0.3), discriminator=partial(Judge, dropout=0.5))
    random = torch.random.get_rng_state()
    one = train(made, tmp_path / "one", quiet=True)
    assert torch.equal(random, torch.random.get_rng_state())
    torch.rand(3)
    train(made.replace(steps=2), tmp_path / "two", quiet=True)
    torch.rand(3)
    two = resume(tmp_path / "two", made, quiet=True)
    assert torch.equal(one.sample(2), two.sample(2))
    other = train(made.replace(seed=1), tmp_path / "other", quiet=True)
    assert not torch.equal(one.sample(2), other.sample(2))


def test_each_step_drops_others() -> None:
    """Else dropout would be of the same units throughout."""
    seen: list[Tensor] = []

    class Noted(Linear):
        def forward(self, code: Tensor) -> Tensor:
            seen.append(torch.rand(2))
            return super().forward(code)

    from unproject.training.recorder import Recorder
    from unproject.training.trainer import Trainer

    class Silent(Recorder):
        def __init__(self) -> None:
            pass

        def write(self, *of: Any, **values: Any) -> None:
            pass

        def show(self, *of: Any) -> None:
            pass

    made = recipe(generator=Noted, checkpoint_every=100)
    trainer = Trainer(made, Path(), Silent())
    with torch.random.fork_rng(devices=[]):
        trainer.step()
        trainer.step()
    assert len(seen) == 2 and not torch.equal(*seen)


def test_every_line_of_the_log_is_told(tmp_path: Path) -> None:
    lines: list[dict[str, Any]] = []
    made = recipe(steps=20, checkpoint_every=20)
    run = train(made, tmp_path / "run", quiet=True, log=lines.append)
    assert lines[-1]["step"] == 20 and lines == run.stats()
    resume(tmp_path / "run", made, steps=40, quiet=True, log=lines.append)
    assert lines[-1]["step"] == 40 and lines == run.stats()
    with pytest.raises(up.UserError, match="log='wandb': give 'tensorboard', or a function"):
        train(made, tmp_path / "other", log="wandb")  # type: ignore[arg-type]
    assert not (tmp_path / "other").exists()


def test_arguments_that_recipe_json_cannot_hold_are_refused_or_imported(tmp_path: Path) -> None:
    """Once a tensor came back as its description, of another length; now the recipe opens the run."""
    made = recipe(generator=partial(Linear, torch.arange(8.0)), steps=1)
    run = train(made, tmp_path / "tensor", quiet=True)
    with pytest.raises(up.UserError, match=r"of the type tensor, .*digest alone; open it by its recipe"):
        load(run.path, trust=True)
    opened = load(run.path, recipe=made)
    assert torch.equal(opened.sample(2), run.sample(2)) and opened.recipe() is made
    with pytest.raises(up.UserError, match="generator differs"):
        load(run.path, recipe=recipe(generator=partial(Linear, torch.arange(9.0)), steps=1))
    run = train(recipe(generator=partial(Linear, activation=nn.SiLU), steps=1), tmp_path / "class", quiet=True)
    assert torch.equal(load(run.path, trust=True).sample(2), run.sample(2))


def test_a_generator_that_cannot_be_imported_is_opened_by_its_recipe(tmp_path: Path) -> None:
    made = recipe(generator=lambda: Linear(), steps=1)
    run = train(made, tmp_path / "run", quiet=True)
    with pytest.raises(up.UserError, match="lambda .* open it by its recipe"):
        load(run.path, trust=True)
    assert torch.equal(load(run.path, recipe=made).sample(2), run.sample(2))


def test_arrays_and_bytes_are_fitted_as_their_floats(tmp_path: Path) -> None:
    run = train(recipe(steps=1), tmp_path / "run", quiet=True)
    fitter = run.fitter(search=up.inversion.Search(candidates=4, starts=1, steps=2, tune=0))
    y = (255 * DATA.floats()[:2]).byte()
    errors = [fitter.fit(given).error for given in (y.float() / 255, (y.float() / 255).numpy(), y, y.numpy())]
    assert len(set(errors)) == 1
    for known in ({"angle": torch.zeros(2)}, {"azimuth": torch.zeros(3)}):
        with pytest.raises(up.UserError, match=r"give \(2,\) values of azimuth"):
            fitter.fit(y, known)
    assert "mmd_iou" in run.evaluate(up.data.chairs(4, SIZE).float().numpy(), n=4)


def test_silhouettes_in_bytes_and_views_in_degrees_are_warned_of() -> None:
    views = up.projections.azimuth_bins(4, up.Silhouette(size=SIZE))
    masks, azimuth = np.ones((4, 1, SIZE, SIZE), np.float32), torch.tensor([0.0, 90, 180, 270])
    with pytest.warns(UserWarning, match="silhouettes run to 255, not to 1"):
        up.Panel(views, up.Collection(255 * masks))
    with pytest.warns(UserWarning, match="azimuth is beyond 4 π; give radians"):
        up.Panel(views, up.Collection(masks, latents={"azimuth": azimuth}))


def test_runs_and_recipes_are_short_in_a_notebook(tmp_path: Path) -> None:
    run = train(recipe(steps=1), tmp_path / "run", quiet=True)
    assert repr(run) == f"Run('{tmp_path / 'run'}', 1 steps, Linear, volume)"
    assert repr(run.given) == "Recipe(Linear, panels: mip (6), steps=1, minutes=None, batch=4, seed=0)"

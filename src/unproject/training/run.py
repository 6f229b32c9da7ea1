"""Run: a run on disk, opened for sampling and scoring."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from .._objects import find_object
from .._random import seeded
from .._types import UserError
from ..assignment import AssignmentState
from ..data import Collection
from ..data.collection import as_floats
from ..domains import Domain, domain_of
from ..inversion import Fitter, Search, Viewing
from ..metrics import Score
from ..networks import Generator
from . import checkpoint
from .budget import progress_of
from .building import build, build_domain
from .compatibility import check_data, check_same
from .counters import COUNTERS
from .distribution import device_of
from .evaluation import estimated_view_scores, observed_scores, sample_scores, self_checks
from .fitting import state_of, viewing_of
from .memory import require_memory
from .origin import read_origin, rebuild
from .recipe import Recipe
from .run_directory import read_log, read_recipe
from .state import begin_assignments, keep_hull_if_level, load_module
from .verdict import Verdict, judge

MAX_UNCHECKED = 10_000
"""Samples from which on their memory is looked at beforehand."""


@dataclass(frozen=True)
class Run:
    """A run on disk.

    Attributes:
        path: the run directory.
        generator: with averaged weights, in evaluation mode.
        step: steps done.
        domain: what the generator makes.
        complete: whether the budget is spent; False if training was stopped before.
        given: the recipe that it was trained or opened with, if it was given; else a recipe function makes it again.
        trusted: whether code outside this package may be imported for it.

    Examples:
        >>> import functools, unproject as up
        >>> panel = up.Panel([up.Observation("itself", up.Identity())], up.Collection(up.data.chairs(4, 16)))
        >>> recipe = up.Recipe(
        ...     functools.partial(up.networks.LowRankGenerator, size=16, channels=8, rank=4, code_size=4),
        ...     [panel],
        ...     discriminator=functools.partial(up.networks.Discriminator, channels=4, volumetric=True),
        ...     steps=1,
        ...     batch=2,
        ... )
        >>> run = up.train(recipe, "runs/scored", quiet=True)
        >>> run.stats()
        []
        >>> sorted(run.evaluate(n=8))
        ['diversity', 'empty', 'in_one_piece']
    """

    path: Path
    generator: Generator
    step: int
    domain: Domain
    complete: bool = True
    given: Recipe | None = field(default=None, repr=False, compare=False)
    trusted: bool = field(default=False, repr=False, compare=False)

    def __repr__(self) -> str:
        return f"Run('{self.path}', {self.step} steps, {type(self.generator).__name__}, {self.domain.name})"

    def sample(self, n: int, seed: int = 0, *, largest_part: bool = False, size: int | None = None) -> Tensor:
        """Return n samples (n, ...) on the CPU; the same seed gives the same ones.

        Args:
            largest_part: join parts of shapes near one another (`ops.joined_parts`), remove those that float
                (`ops.largest_part`) and join by faces what is left (`ops.face_connected`); other samples stay as
                they are.
            size: voxels or texels a side, for generators that make other sizes than their own too
                (`Generator.at_size`): of shapes finer ones, of materials larger ones.

        Raises:
            UserError: for a negative n, a size that the generator cannot make, or what takes more memory than there is.
        """
        if n < 0:
            raise UserError(f"{n} samples: give 0 or more")
        if size is not None:
            require_memory(self.domain.bytes_at(size, n), f"{n} samples of size {size} take", "lower n or size")
        self._require_memory(n)
        x = self.generator.sample(n, seed) if size is None else self.generator.sample(n, seed, size=size)
        return self.domain.largest_part(x) if largest_part else x

    def _require_memory(self, n: int) -> None:
        """Refuse as many samples as do not fit: twice, while they are put together."""
        if n > MAX_UNCHECKED:
            require_memory(8 * n * self.generator.sample(1).numel(), f"{n} samples take", "lower n")

    def stats(self) -> list[dict[str, Any]]:
        """Return the lines of the log: `step`, `seconds`, losses and events."""
        return read_log(self.path / "stats.jsonl")

    def recipe(self) -> Recipe:
        """Return the recipe that was given, or make the run's again, which may read a large folder.

        Raises:
            UserError: if no recipe function made it, or one outside unproject and the run is not trusted.
        """
        return self.given or rebuild(read_origin(self.path), self.trusted)

    def with_recipe(self) -> Run:
        """Return the run with its recipe, made once for all that asks for it.

        Raises:
            UserError: if it cannot be made, or has more or fewer data than in training; if others, there is a warning.
        """
        if self.given is not None:
            return self
        recipe = self.recipe()
        check_data(self.path, recipe)
        return replace(self, given=recipe)

    def evaluate(
        self,
        reference: Tensor | np.ndarray | Collection | Mapping[str, Tensor] | None = None,
        *,
        n: int | None = None,
        seed: int = 0,
        ceiling: bool = False,
    ) -> dict[str, Score]:
        """Score the run: its samples, their projections, and the views that it estimated.

        Args:
            reference: held-out samples, or projections of such, as they are read, or as tensors or arrays; of a run
                with several observations, projections by their names (default: none; then only samples by themselves,
                their projections against the training images, and the views are checked).
            n: samples to score (default: the domain's number).
            seed: of the samples and of the measurement.
            ceiling: also train a view predictor on the known views, which takes a minute or two.

        Raises:
            UserError: for fewer than one sample, if the recipe cannot be made, or the reference does not fit.
        """
        if n is not None and n < 1:
            raise UserError(f"n={n} samples: give at least 1")
        states = self.assignments()
        count = n or self.domain.scored
        self._require_memory(count)
        views = estimated_view_scores(self.domain, states, seed, ceiling)
        if reference is None:
            return self_checks(self.generator, self.domain, states, count, seed) | views
        if isinstance(reference, Mapping):
            return observed_scores(self.generator, self.domain, states, reference, count, seed) | views
        references = reference if isinstance(reference, Collection) else Collection(as_floats(reference))
        return sample_scores(self.generator, self.domain, states, references, count, seed) | views

    def verdict(self, *, seed: int = 0) -> Verdict:
        """Judge the run by a few dozen samples: whether views are found, projections match pictures, and so on.

        Args:
            seed: of the samples and of the measurement.

        Raises:
            UserError: if the recipe cannot be made.
        """
        return judge(self.generator, self.domain, self.assignments(), seed)

    def fitter(
        self,
        observation: str | None = None,
        *,
        viewing: Viewing | None = None,
        search: Search | None = None,
        seed: int = 0,
    ) -> Fitter:
        """Return what finds samples behind pictures (`Fitter.fit`), on the CPU.

        Args:
            observation: which of the run's observations made the pictures (default: any of its only panel).
            viewing: how pictures come about, in place of the run's observations.
            search: its settings (default: `Search()`).
            seed: of the search.

        Raises:
            UserError: if the recipe cannot be made, does not say how the pictures come about, or the candidates take
                more memory than there is.
        """
        if viewing is None:
            viewing = viewing_of(state_of(self.assignments(), observation), observation)
        search = search or Search()
        generator = copy.deepcopy(self.generator).cpu()  # what is compared for one picture is small
        x = generator.sample(1)
        each = x.numel() + 3 * len(viewing.priors) * x.shape[-1] ** 2  # with its projections, of three channels at most
        need = 8 * search.candidates * each  # twice, while they are put together
        require_memory(need, f"{search.candidates} candidates take", "lower candidates")
        return Fitter(generator, viewing, search, seed, self.domain.repeated)

    def assignments(self) -> list[AssignmentState]:
        """Return the assignment of each panel as the newest checkpoint has it.

        Raises:
            UserError: if the recipe cannot be made, or has more or fewer data than the run was trained on; if others,
                there is a warning.
        """
        recipe = self.with_recipe().recipe()
        with seeded(recipe.seed, "weights"):
            states = begin_assignments(recipe)
        newest = checkpoint.newest(self.path / "checkpoints")
        for i, state in enumerate(states):
            prefix = f"panels/{i}/assignment"
            load_module(state, checkpoint.load(newest, f"{prefix}/"), prefix)
        return states


def load(
    path: str | Path, *, device: str = "cpu", trust: bool = False, recipe: Recipe | None = None, step: int | None = None
) -> Run:
    """Open a run: the averaged weights of its newest checkpoint. The training data are not needed.

    The classes of generator and domain are named in recipe.json. Classes of this package are built at once; a class
    from elsewhere would run its module's code, so it is imported only with `trust=True`.

    Args:
        path: the run directory.
        device: where to put the generator: "auto", "cpu" or "cuda".
        trust: import code outside this package.
        recipe: the run's recipe, which builds the generator in place of what recipe.json names: for a class that
            cannot be imported, as of a notebook, or whose arguments are tensors. Nothing else needs `trust` then.
        step: of the checkpoint, if not the newest; the oldest are removed while a run is trained.

    Raises:
        UserError: if `path` is no run, has no checkpoint yet or none of `step`, is damaged, or is not trusted; if
            `recipe` has another generator or domain, or other data.

    Examples:
        >>> import functools, unproject as up
        >>> panel = up.Panel([up.Observation("itself", up.Identity())], up.Collection(up.data.chairs(4, 16)))
        >>> recipe = up.Recipe(
        ...     functools.partial(up.networks.LowRankGenerator, size=16, channels=8, rank=4, code_size=4),
        ...     [panel],
        ...     discriminator=functools.partial(up.networks.Discriminator, channels=4, volumetric=True),
        ...     steps=1,
        ...     batch=2,
        ... )
        >>> run = up.train(recipe, "runs/opened", quiet=True)
        >>> up.load(run.path).sample(1, seed=7).equal(run.sample(1, seed=7))
        True
    """
    path, place = Path(path), device_of(device)
    stored = read_recipe(path)
    if recipe is not None:
        check_same(path, recipe)
        generator, given = recipe.generator(), recipe.domain
    else:
        if trust and ":" in stored["recipe"]:
            find_object(stored["recipe"])  # its file is no module that could be imported by name
        generator = build(path, stored["resolved"].get("generator"), Generator, trust)
        described = stored["resolved"].get("domain")
        given = None if described is None else build_domain(path, described, trust)
    domain = domain_of(generator, given)
    file = checkpoint.chosen(path / "checkpoints", step)
    tensors = checkpoint.load(file, "average/")
    try:
        generator.load_state_dict({name.removeprefix("average/"): v for name, v in tensors.items()})
    except RuntimeError as error:
        raise UserError(f"{file}: the weights do not fit recipe.json: another run's or version's") from error
    keep_hull_if_level(generator, checkpoint.load(file, "panels/"))
    step = checkpoint.step_of(file)
    spent = checkpoint.load(file, f"{COUNTERS}seconds").values()  # nothing in a shared run
    complete = all(progress_of(stored["resolved"], step, float(seconds.sum())) >= 1 for seconds in spent)
    return Run(path, generator.eval().to(place), step, domain, complete, given=recipe, trusted=trust)

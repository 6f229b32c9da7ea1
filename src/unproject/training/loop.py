"""The training loop: `train` and `resume`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

from .._random import own_random_state
from .._types import UserError
from . import checkpoint, event_file, run_directory
from .budget import has_budget, store_budget
from .compatibility import check_same
from .distribution import Distribution
from .health import Diverged
from .lock import locked
from .origin import read_origin, rebuild
from .parts import check_parts
from .recipe import Recipe
from .recorder import Recorder
from .recovery import roll_back
from .run import Run
from .signals import stop_request
from .start import grow_from, start_from
from .state import State
from .trainer import Interrupted, Trainer

Log: TypeAlias = Literal["tensorboard"] | Callable[[dict[str, Any]], object]


def train(
    recipe: Recipe,
    out: str | Path,
    *,
    start: str | Path | None = None,
    device: str = "auto",
    quiet: bool = False,
    log: Log | None = None,
) -> Run:
    """Train a recipe into a new run directory and return the run.

    Args:
        recipe: what to train.
        out: the run directory to make.
        start: a run to take the weights of instead of random ones: of the generator, whose architecture must be the
            same, or of half the size (`Generator.grow`), and of discriminators and the view predictor where they fit.
            It may be deleted afterwards. What a recipe would train first at half the size is left out.
        device: "auto", "cpu" or "cuda".
        quiet: show no progress bar.
        log: "tensorboard" keeps the log as an event file of TensorBoard too, in OUT/tensorboard; or a function that is
            called with each line of stats.jsonl, a dictionary, in the process that writes it.

    Raises:
        UserError: if `out` holds a run already, parts of the recipe do not fit one another (`check_parts`), the
            generator of `start` is another, or training diverges twice, or before its first checkpoint.
        OSError: if the disk is full; checkpoints already written stay good.

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
        >>> run = up.train(recipe, "runs/train", quiet=True)
        >>> run.step, run.sample(2).shape
        (1, torch.Size([2, 16, 16, 16]))
    """
    _check_log(log)
    distribution = Distribution(device)
    out = Path(out)
    recipe = recipe if start is None else _of_one_size(recipe)
    run_directory.check_free(out, recipe)
    state = State(recipe, distribution.device)  # before anything is written: a part may refuse its arguments
    check_parts(recipe, state)
    began = None if start is None else start_from(state, Path(start))
    if began is not None:
        _share_assignments(state, distribution)
    content = run_directory.content_of(recipe, began)
    distribution.barrier()
    if distribution.leads:
        out.mkdir(parents=True, exist_ok=True)
    with locked(out, distribution.leads):
        if distribution.leads:
            run_directory.check_free(out)  # another process may have made a run there meanwhile
            run_directory.create(out, content)
        if began is not None and distribution.leads:
            checkpoint.save(out / "checkpoints", 0, state.tensors())
        try:
            if not _trained_coarse(recipe, out, state, distribution, device, quiet, log):
                return Run(out, state.sampler(), 0, state.domain, False, recipe)
            return _run(recipe, out, state, distribution, quiet, log)
        except Exception:  # as that there is too little memory: the same command is to find the place free
            if distribution.leads and not state.counters.step:
                run_directory.remove_begun(out)
            raise


def resume(
    path: str | Path,
    recipe: Recipe | None = None,
    *,
    steps: int | None = None,
    minutes: float | None = None,
    device: str = "auto",
    trust: bool = False,
    quiet: bool = False,
    log: Log | None = None,
) -> Run:
    """Continue a run from its newest checkpoint.

    Args:
        path: the run directory.
        recipe: the recipe of the run; needed only if it was not made by a recipe function.
        steps, minutes: the new budget in all, what is already spent included; the run keeps it.
        device: "auto", "cpu" or "cuda".
        trust: import the recipe's code although it is not of this package.
        quiet: show no progress bar.
        log: "tensorboard", or a function that is called with each new line of stats.jsonl, as of `train`; an event
            file that is there is continued anyway.

    Raises:
        UserError: if there is no run, the recipe is another, or the recipe is needed and not given.

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
        >>> run = up.train(recipe, "runs/resume", quiet=True)
        >>> up.resume(run.path, recipe, steps=2, quiet=True).step
        2
    """
    _check_log(log)
    path = Path(path)
    if checkpoint.has_weights_alone(path / "checkpoints"):
        raise UserError(f"{path}: has weights alone, as of a shared run; begin a new run with train --from {path}")
    if recipe is None:
        recipe = rebuild(read_origin(path), trust, steps=steps, minutes=minutes)
    elif steps is not None or minutes is not None:
        recipe = recipe.replace(steps=steps, minutes=minutes)
    distribution = Distribution(device)
    check_same(path, recipe)
    started = run_directory.read_recipe(path)["start"] is not None
    recipe = _of_one_size(recipe) if started else recipe
    state = State(recipe, distribution.device)
    other_budget = distribution.agree(not has_budget(path, recipe))  # all look before the first process stores it
    with locked(path, distribution.leads):
        if distribution.leads:
            run_directory.remove_temporaries(path)
        if checkpoint.list_checkpoints(path / "checkpoints"):
            state.load(checkpoint.load(checkpoint.newest(path / "checkpoints")))
        elif started:
            raise UserError(f"{path}: was stopped before its first weights were stored; delete it, and train again")
        elif not _trained_coarse(recipe, path, state, distribution, device, quiet, log):
            return Run(path, state.sampler(), 0, state.domain, False, recipe)
        if other_budget:
            state.go_on_from(recipe.progress(state.counters.step, state.counters.seconds))
        if distribution.leads:
            store_budget(path, recipe)
        return _run(recipe, path, state, distribution, quiet, log)


def _check_log(log: object) -> None:
    if not (log is None or log == "tensorboard" or callable(log)):
        raise UserError(f"log={log!r}: give 'tensorboard', or a function that is called with each line of the log")


def _of_one_size(recipe: Recipe) -> Recipe:
    """Return a recipe that spends its budget at full size, for a run that starts from another one's weights."""
    if recipe.coarse is None:
        return recipe
    return recipe.replace(coarse=replace(recipe.coarse, share=0.0), origin=recipe.origin)


def _trained_coarse(
    recipe: Recipe, out: Path, state: State, distribution: Distribution, device: str, quiet: bool, log: Log | None
) -> bool:
    """Train the coarse recipe, if there is one, or go on with it, and take over its weights; False if stopped."""
    coarse = recipe.coarse_recipe()
    if coarse is None:
        return True
    place = out / run_directory.COARSE
    if distribution.agree((place / "recipe.json").exists()):
        run = resume(place, coarse, device=device, quiet=quiet, log=log)
    else:
        run = train(coarse, place, device=device, quiet=quiet, log=log)
    if not run.complete:
        return False
    grow_from(state, place)
    _share_assignments(state, distribution)
    if distribution.leads:
        checkpoint.save(out / "checkpoints", state.counters.step, state.tensors())
    return True


def _share_assignments(state: State, distribution: Distribution) -> None:
    """Let all processes have what the leading one took over: another machine may have predicted other views."""
    for panel in state.panels:
        distribution.copy_from_leader([*panel.assignment.parameters(), *panel.assignment.buffers()])


def _run(recipe: Recipe, out: Path, state: State, distribution: Distribution, quiet: bool, log: Log | None) -> Run:
    tell = log if callable(log) else None
    if log == "tensorboard" and distribution.leads:
        (out / event_file.FOLDER).mkdir(exist_ok=True)
    with (
        Recorder(out, state.counters.lines, distribution.leads, quiet, tell) as recorder,
        stop_request() as stop,
        own_random_state(distribution.device),
    ):
        trainer = Trainer(recipe, out, recorder, state, distribution, stop)
        while True:
            try:
                if trainer.progress() < 1 and not trainer.stopping():
                    trainer.step()
                    continue
                trainer.save()
                break
            except Interrupted:
                trainer.undo()
                if trainer.state.counters.step:  # else there is nothing to go on from
                    trainer.save()
                break
            except Diverged as trouble:
                roll_back(trainer, trouble)
        complete = trainer.saved is not None and trainer.saved[1]  # as it will load, whatever the clock says by now
    distribution.close()
    return Run(out, state.sampler(), state.counters.step, state.domain, complete, recipe)

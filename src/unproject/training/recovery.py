"""Recovery: a run that diverges is rolled back once to its last checkpoint."""

from __future__ import annotations

import time

from . import checkpoint
from .health import Diverged
from .trainer import Trainer


def roll_back(trainer: Trainer, trouble: Diverged) -> None:
    """Return to the last checkpoint with half the learning rate; raise `trouble` the second time.

    The rate is that of generator and discriminators; what assignments learn keeps its own.
    """
    checkpoints = checkpoint.list_checkpoints(trainer.out / "checkpoints")
    counters = trainer.state.counters
    if counters.rollbacks or not checkpoints:
        raise trouble
    at, seconds = counters.step, counters.seconds
    trainer.state.load(checkpoint.load(checkpoints[-1]))
    counters.rollbacks, counters.rate_scale, counters.collapsed = 1, counters.rate_scale / 2, 0
    trainer.began, trainer.saved = time.monotonic() - seconds, None
    trainer.state.go_on_from(trainer.progress())  # minutes that were trained in vain are spent
    trainer.recorder.say(f"{trouble}; rolling back to step {counters.step} with half the learning rate")
    trainer.recorder.write(counters.step, seconds, event="rollback", at=at, reason=str(trouble))

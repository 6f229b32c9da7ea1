"""Pace: slow steps are told of once, when there are many, and not where the number of threads is not to blame."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

import unproject as up
from unproject.training import pace as pace_module
from unproject.training import trainer as trainer_module
from unproject.training.pace import TIMES, WINDOW, Pace

from .toy import toy


def told(seconds: list[float]) -> list[tuple[int, float]]:
    pace = Pace()
    found = [pace.add(each) for each in seconds]
    return [(step, times) for step, times in enumerate(found, 1) if times is not None]


def test_steps_that_have_come_to_take_much_longer_are_told_of_once() -> None:
    steps = 3 * WINDOW * [0.2] + 5 * WINDOW * [2.0] + 2 * WINDOW * [0.2] + 5 * WINDOW * [4.0]
    assert told(steps) == [(5 * WINDOW, pytest.approx(10))]


@pytest.mark.parametrize(
    "steps",
    [
        6 * WINDOW * [0.2],
        2 * WINDOW * [0.2] + 4 * WINDOW * [TIMES * 0.2],
        2 * WINDOW * [0.2] + WINDOW * [9.0] + 2 * WINDOW * [0.2] + WINDOW * [9.0] + WINDOW * [0.2],
        WINDOW * [9.0] + 5 * WINDOW * [0.2],
        6 * ((WINDOW - WINDOW // 3) * [0.2] + WINDOW // 3 * [9.0]),
    ],
    ids=["even", "four times", "a moment", "slow at first", "some steps"],
)
def test_other_steps_are_not(steps: list[float]) -> None:
    assert told(steps) == []


@pytest.mark.parametrize("threads, says", [(2, True), (1, False)])
def test_a_training_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, threads: int, says: bool
) -> None:
    """The numbers are those of a run that was never slow."""
    monkeypatch.setattr(pace_module, "WINDOW", 1)
    monkeypatch.setattr(torch, "get_num_threads", lambda: threads)
    clock, slow_from = [0.0], [math.inf]

    def later() -> float:
        clock[0] += 1.0 if clock[0] < slow_from[0] else 100.0
        return clock[0]

    monkeypatch.setattr(trainer_module.time, "monotonic", later)
    plain = up.train(toy(steps=40), tmp_path / "plain", quiet=True).sample(2)
    assert capsys.readouterr().err == ""
    slow_from[0] = clock[0] + clock[0] / 2
    slow = up.train(toy(steps=40), tmp_path / "slow", quiet=True).sample(2)
    error = " ".join(capsys.readouterr().err.split())
    line = "times as long as they did: other programs keep cores busy, and threads wait for one another; stop it"
    assert error.count(line) == says and ("resume it with --threads 1" in error) == says
    assert slow.equal(plain)

"""The progress bar says which time has passed and which remains."""

from __future__ import annotations

import io
from pathlib import Path

from rich.console import Console

from unproject.training.recorder import Recorder


def rendered(recorder: Recorder) -> str:
    console = Console(file=io.StringIO(), width=160)
    with console.capture() as captured:
        console.print(recorder.bar.get_renderable())
    return captured.get()


def test_the_bar_names_the_time_elapsed_and_the_time_left(tmp_path: Path) -> None:
    recorder, now = Recorder(tmp_path), 0.0
    recorder.bar.get_time = recorder.bar.tasks[0]._get_time = lambda: now
    recorder.bar.reset(recorder.task)
    for now in map(float, range(0, 197, 4)):
        recorder.show(now / 199.5, "step 98")
    recorder.stream.close()
    assert " 98% · 0:03:16 elapsed · 0:00:04 left step 98" in rendered(recorder)

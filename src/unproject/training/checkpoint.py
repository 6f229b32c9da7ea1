"""Checkpoints: one safetensors file each, appearing whole or not at all. Nothing in them is executable."""

from __future__ import annotations

import os
import re
from pathlib import Path

from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from .._files import atomic_path, check_encoded
from .._types import UserError
from .counters import COUNTERS, Counters

FORMAT = "unproject-1"
KEEP = 2
OLDER = "delete it, and the run resumes from the one before"


def save(folder: Path, step: int, tensors: dict[str, Tensor]) -> Path:
    """Write the checkpoint of a step, then drop all but the newest two. A full disk leaves the older ones."""
    path = checkpoint_of(folder, step)
    with atomic_path(path) as temporary:
        temporary.touch()
        mode = temporary.stat().st_mode  # as the umask says; the library's files are for their owner alone
        try:
            save_file(tensors, temporary, metadata={"format": FORMAT})
        except SafetensorError as error:  # the library's name for a failed write
            raise _as_os_error(path, error) from error
        temporary.chmod(mode)
    for old in list_checkpoints(folder)[:-KEEP]:
        old.unlink()
    return path


def _as_os_error(path: Path, error: SafetensorError) -> OSError:
    """The error that the system gave, whose number the library puts into its message."""
    number = re.search(r"os error (\d+)", str(error))
    return OSError(int(number[1]), os.strerror(int(number[1])), str(path)) if number else OSError(f"{path}: {error}")


def list_checkpoints(folder: Path) -> list[Path]:
    """The checkpoints of a folder, oldest first."""
    return sorted(path for path in folder.glob("step-*.safetensors") if path.stem.removeprefix("step-").isdecimal())


def checkpoint_of(folder: Path, step: int) -> Path:
    """The checkpoint of a step."""
    return folder / f"step-{step:09d}.safetensors"


def has_weights_alone(folder: Path) -> bool:
    """Whether the newest checkpoint is that of a shared run, from which training cannot go on."""
    stored = list_checkpoints(folder)
    return bool(stored) and not load(stored[-1], f"{COUNTERS}step")


def counters_of(path: Path) -> Counters:
    """The counters of a checkpoint; of a shared run, which has none, all are 0."""
    found, tensors = Counters(), load(path, COUNTERS)
    if tensors:
        found.load(tensors)
    return found


def step_of(path: Path) -> int:
    """The step of a checkpoint, by its name."""
    return int(path.stem.removeprefix("step-"))


def newest_step(folder: Path) -> int:
    """The step of the newest checkpoint, 0 if there is none."""
    found = list_checkpoints(folder)
    return step_of(found[-1]) if found else 0


def newest(folder: Path) -> Path:
    """The newest checkpoint. Raises UserError if there is none."""
    found = list_checkpoints(folder)
    if not found:
        raise UserError(f"{folder}: no checkpoint yet; train longer, or lower --checkpoint-every")
    return found[-1]


def chosen(folder: Path, step: int | None = None) -> Path:
    """The checkpoint of a step, by default the newest. Raises UserError if there is none."""
    if step is None:
        return newest(folder)
    file = checkpoint_of(folder, step)
    if not file.exists():
        kept = ", ".join(f"{step_of(other):,}" for other in list_checkpoints(folder)) or "none"
        raise UserError(f"{folder}: no checkpoint of step {step:,}; those that are kept: {kept}")
    return file


def load(path: Path, prefix: str = "") -> dict[str, Tensor]:
    """The tensors of a checkpoint whose names begin with `prefix`.

    Raises:
        UserError: if it is not one of ours, or its name is not UTF-8.
        OSError: if the system does not let it be read.
    """
    check_encoded(path)
    if path.is_file():
        path.open("rb").close()  # what the system refuses is not damaged
    try:
        with safe_open(path, framework="pt") as file:
            check_format(path, (file.metadata() or {}).get("format", ""))
            wanted = [name for name in file.keys() if name.startswith(prefix)]  # noqa: SIM118
            tensors = {name: file.get_tensor(name).clone() for name in wanted}  # else they live in the mapped file
            for name, values in tensors.items():  # none that is not finite is ever written
                if values.is_floating_point() and not values.isfinite().all():
                    raise UserError(f"{path}: damaged ({name} is not finite); {OLDER}")
            return tensors
    except UserError:
        raise
    except Exception as error:  # types and dimensions that torch has not, lengths that no number holds
        raise UserError(f"{path}: damaged ({error}); {OLDER}") from error


def check_format(path: Path, stored: str) -> None:
    """Raise UserError unless a checkpoint's format is ours: it may be of a newer version, or of another program."""
    if stored.startswith(FORMAT.rstrip("0123456789")) and stored != FORMAT:
        raise UserError(f"{path}: written by a newer version of unproject ({stored}, not {FORMAT}); use that version")
    if stored != FORMAT:
        raise UserError(f"{path}: not a checkpoint of unproject ({FORMAT}); point to a run of this program")


def why_unreadable(folder: Path) -> str:
    """Return why the newest checkpoint cannot be read, by its header; "" if it can be, or there is none."""
    found = list_checkpoints(folder)
    try:
        if found:
            load(found[-1], prefix="?")
    except UserError as error:
        return str(error)
    return ""

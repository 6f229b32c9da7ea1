"""Checkpoint files: the newest two are kept, others' files and damaged ones are refused, what was read stays."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from unproject._types import UserError
from unproject.training import checkpoint
from unproject.training.checkpoint import list_checkpoints, step_of


def save(folder: Path, *steps: int) -> Path:
    """The last of these checkpoints, each holding its step."""
    return [checkpoint.save(folder, step, {"a/step": torch.tensor([step]), "b": torch.ones(1)}) for step in steps][-1]


def test_the_newest_two_steps_are_kept_whatever_the_order_of_their_dates(tmp_path: Path) -> None:
    save(tmp_path, 10, 9, 200)
    assert [path.name[5:14] for path in checkpoint.list_checkpoints(tmp_path)] == ["000000010", "000000200"]
    assert checkpoint.load(checkpoint.newest(tmp_path))["a/step"].item() == 200


def test_a_prefix_loads_a_part(tmp_path: Path) -> None:
    assert set(checkpoint.load(save(tmp_path, 1), "a/")) == {"a/step"}


def test_what_was_loaded_does_not_change_with_its_file(tmp_path: Path) -> None:
    path = checkpoint.save(tmp_path, 1, {"a": torch.arange(100_000)})
    loaded = checkpoint.load(path)["a"]
    with path.open("r+b") as file:
        file.seek(-400_000, 2)
        file.write(bytes(400_000))
    assert torch.equal(loaded, torch.arange(100_000))


@pytest.mark.parametrize(
    ("metadata", "why"),
    [
        (None, "not a checkpoint of unproject"),
        ({"format": "pt"}, "not a checkpoint of unproject"),
        ({"format": checkpoint.FORMAT + "0"}, "written by a newer version"),
    ],
)
def test_a_file_of_another_program_is_refused(tmp_path: Path, metadata: dict[str, str] | None, why: str) -> None:
    path = tmp_path / "step-000000001.safetensors"
    save_file({"a": torch.ones(1)}, path, metadata=metadata)
    with pytest.raises(UserError, match=why):
        checkpoint.load(path)


def test_a_damaged_file_is_refused_and_an_empty_folder_too(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no checkpoint yet"):
        checkpoint.newest(tmp_path)
    path = save(tmp_path, 1)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(UserError, match="damaged"):
        checkpoint.load(path)


def test_files_of_other_names_are_no_checkpoints(tmp_path: Path) -> None:
    for name in ("step-000000002", "step-best", "step-000000001"):
        (tmp_path / f"{name}.safetensors").touch()
    assert [step_of(path) for path in list_checkpoints(tmp_path)] == [1, 2]


def test_a_file_has_the_rights_that_other_files_have(tmp_path: Path) -> None:
    """The library's own are for their owner alone, so that nobody could open a shared run."""
    (tmp_path / "other").touch()
    path = checkpoint.save(tmp_path, 1, {"a": torch.ones(1)})
    assert path.stat().st_mode == (tmp_path / "other").stat().st_mode


def test_a_file_that_may_not_be_read_is_not_called_damaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = checkpoint.save(tmp_path, 1, {"a": torch.ones(1)})

    def refused(self: Path, mode: str) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    with monkeypatch.context() as patch, pytest.raises(PermissionError):
        patch.setattr(Path, "open", refused)
        checkpoint.load(path)


def test_names_that_are_not_utf_8_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is not UTF-8; choose another"):
        checkpoint.load(tmp_path / "\udcff.safetensors")


def test_a_step_is_chosen_if_it_is_kept(tmp_path: Path) -> None:
    for step in (2, 4):
        checkpoint.save(tmp_path, step, {"x": torch.zeros(1)})
    assert step_of(checkpoint.chosen(tmp_path)) == 4 and step_of(checkpoint.chosen(tmp_path, 2)) == 2
    with pytest.raises(UserError, match="no checkpoint of step 3; those that are kept: 2, 4"):
        checkpoint.chosen(tmp_path, 3)

"""Volumes: what they are written as."""

from __future__ import annotations

from pathlib import Path

import torch
import trimesh

from unproject.domains import Volumes
from unproject.export import Written


def test_an_exporter_of_ones_own_is_given_what_it_takes(tmp_path: Path) -> None:
    """It may have the name of one of ours, which takes more."""

    class Own(Volumes):
        @property
        def exporters(self):  # noqa: ANN202
            return {**super().exporters, "obj": lambda x, path: Written((Path(path),))}

    x = torch.zeros(2, 8, 8, 8)
    x[:, 2:4, 2:4, 2:4] = x[:, 4:6, 4:6, 4:6] = 1
    assert Own().write(x, "obj", tmp_path / "x.obj", numbers=(3, 5)).paths == (tmp_path / "x.obj",)
    Own().write(x, "ply", tmp_path / "ply", numbers=(3, 5))
    assert sorted(file.name for file in (tmp_path / "ply").iterdir()) == ["shape_03.ply", "shape_05.ply"]
    for part, count in ((True, 1), (False, 2)):
        Own().write(x, "ply", tmp_path / f"{part}", largest_part=part)
        assert trimesh.load(tmp_path / f"{part}" / "shape_00.ply", force="mesh").body_count == count


def test_a_foot_at_the_end_of_a_slanted_leg_is_written(tmp_path: Path) -> None:
    x = torch.zeros(1, 16, 16, 16)
    x[:, 4:12, 8:14, 4:12] = 0.9
    for k in range(6):
        x[:, 7 + k, 7 - k, 7] = 0.8
    (path,) = Volumes().write(x, "ply", tmp_path / "bird.ply").paths
    surface = trimesh.load(path, force="mesh")
    assert surface.body_count == 1 and surface.bounds[0, 1] < -0.6


def test_parts_that_nearly_touch_are_joined_before_others_are_removed() -> None:
    x = torch.zeros(1, 10, 4, 4)
    x[:, :3], x[:, 4:6], x[:, 9:] = 1, 1, 1
    x[:, 3, 1, 1] = 0.4
    whole = Volumes().largest_part(x)
    assert whole[0, 4:6].sum() == 32 and whole[0, 3, 1, 1] > 0.5 and whole[0, 6:].sum() == 0

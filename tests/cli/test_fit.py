"""`unproject fit`: objects behind pictures, in folders of files, and what it says of pictures of something else."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._types import UserError
from unproject.cli import main
from unproject.data import Collection, chairs
from unproject.domains import Images
from unproject.inversion import Novelty, Search, Viewing
from unproject.metrics import Gauge, apply
from unproject.projections import Silhouette, azimuth_bins
from unproject.training import load
from unproject.training.fitted_pictures import Frame, given_view, known_views, view_of
from unproject.training.fitting import viewing_of
from unproject.training.given_pictures import observed

QUICK = ["--candidates", "8", "--starts", "2", "--steps", "3", "--tune", "2", "--threads", "1"]


@pytest.fixture(scope="module", autouse=True)
def few_chairs() -> Iterator[None]:
    """Every fit makes the run's data again."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 150)
        yield


@pytest.fixture(scope="module")
def shapes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A toy run of shapes, that learned hardly anything."""
    out = tmp_path_factory.mktemp("runs") / "shapes"
    flags = "--size 16 --channels 16 --rank 8 --batch 16 --steps 60 --views known --rate 0.005 --solid 0.5 --gamma 0.01"
    words = ["train", "shapes", *flags.split(), "--ema-half-life", "0", "--out", str(out), "--quiet"]
    assert main(words) == 0
    return out


@pytest.fixture(scope="module")
def masks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("masks")
    for k in range(3):
        y = Silhouette(size=48)(chairs(3, 32, seed=5)[k : k + 1], azimuth=torch.tensor([0.7 * k]))
        Image.fromarray(((y[0, 0] > 0.5) * 255).byte().numpy()).save(folder / f"chair{k}.png")
    return folder


def fit(*words: object) -> int:
    return main(["fit", *map(str, words), *QUICK])


def entries(out: Path) -> list[dict]:
    return json.loads((out / "fit.json").read_text())["fits"]


def test_a_folder_of_pictures_becomes_a_thing_each(
    shapes: Path, masks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Of what kind they are is not asked here.
    monkeypatch.setattr(Novelty, "fitted", partial(Novelty.fitted, steps=10))
    out = tmp_path / "fits"
    assert fit(shapes, masks, "--out", out) == 0
    names = ["chair0", "chair1", "chair2"]
    assert [entry["name"] for entry in entries(out)] == names
    with np.load(out / "fit.npz") as arrays:
        assert arrays["volume"].shape == (3, 16, 16, 16)
    for name in names:
        with np.load(out / name / "fit.npz") as arrays:
            assert arrays["x"].shape == (2, 16, 16, 16) and arrays["deviation"].shape == (16, 16, 16)
    with Image.open(out / "sheet.png") as sheet:
        assert sheet.height > 3 * 64
    for entry in entries(out):
        (view,) = entry["views"]
        assert ("no file" in entry["why"]) != (out / entry["name"] / f"{entry['name']}.glb").is_file()
        assert sum(view["posterior"]) == pytest.approx(1, abs=0.01) and view["distance"] > 0
        assert sum(entry["weights"]) == pytest.approx(1, abs=0.01)


def test_a_run_that_was_stopped_goes_on(shapes: Path, masks: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "fits"
    assert fit(shapes, masks, "--out", out, "--no-novelty") == 0
    first, written = (out / "chair0" / "fit.json"), (out / "chair1" / "fit.json")
    before, kept = json.loads(written.read_text()), first.stat().st_mtime_ns
    written.unlink()
    (out / "fit.json").unlink()
    assert fit(shapes, masks, "--out", out, "--no-novelty") == 0
    assert first.stat().st_mtime_ns == kept
    again = json.loads(written.read_text())
    assert {**again, "seconds": 0} == {**before, "seconds": 0}
    capsys.readouterr()
    assert fit(shapes, masks, "--out", out, "--no-novelty", "--seed", "1") == 2
    assert "give another --out" in capsys.readouterr().err


@pytest.mark.parametrize("flags", [["--seed", "1"], ["--view", "40"]], ids=["seed", "view"])
def test_fits_by_other_flags_are_not_taken_for_these(shapes: Path, masks: Path, tmp_path: Path, capsys, flags) -> None:
    words = [shapes, masks / "chair0.png", "--out", tmp_path / "fits", "--no-novelty"]
    assert fit(*words) == 0
    assert fit(*words, *flags) == 2
    assert "give another --out" in capsys.readouterr().err


def test_other_pictures_of_the_same_name_are_not_taken_for_these(shapes: Path, masks: Path, tmp_path: Path) -> None:
    picture, out = tmp_path / "chair.png", tmp_path / "fits"
    picture.write_bytes((masks / "chair0.png").read_bytes())
    assert fit(shapes, picture, "--out", out, "--no-novelty") == 0
    picture.write_bytes((masks / "chair1.png").read_bytes())
    assert fit(shapes, picture, "--out", out, "--no-novelty") == 2


def test_pictures_of_one_name_stay_two(shapes: Path, masks: Path, tmp_path: Path, capsys) -> None:
    folder = tmp_path / "masks"
    folder.mkdir()
    for suffix in ("png", "bmp"):
        with Image.open(masks / "chair0.png") as picture:
            picture.save(folder / f"chair.{suffix}")
    assert fit(shapes, folder, "--out", tmp_path / "fits", "--no-novelty") == 2
    assert "would be called chair" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["fit.npz", "FIT.json", "sheet.png", "settings.json"])
def test_an_object_with_the_name_of_a_file_of_all_fits_is_refused(
    shapes: Path, masks: Path, tmp_path: Path, capsys, name: str
) -> None:
    shutil.copy(masks / "chair0.png", tmp_path / f"{name}.png")
    assert fit(shapes, tmp_path / f"{name}.png", "--out", tmp_path / "fits", "--no-novelty") == 2
    assert f"its folder would be {name}, which is a file of all fits; rename it" in capsys.readouterr().err
    assert not (tmp_path / "fits").exists()


def test_paths_may_be_relative_and_absolute(shapes: Path, masks: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(masks)
    assert fit(shapes, "chair0.png", masks / "chair1.png", "--out", tmp_path / "fits", "--no-novelty") == 0
    assert [entry["name"] for entry in entries(tmp_path / "fits")] == ["chair0", "chair1"]


def test_several_pictures_of_one_thing(shapes: Path, masks: Path, tmp_path: Path) -> None:
    out = tmp_path / "fits"
    assert fit(shapes, *sorted(masks.iterdir()), "--out", out, "--together", "--no-novelty", "--to", "obj") == 0
    (entry,) = entries(out)
    assert len(entry["views"]) == 3 and entry["p"] is None
    assert ("no file" in entry["why"]) != (out / "together" / "together.obj").is_file()


def test_views_that_are_given_are_kept(shapes: Path, masks: Path, tmp_path: Path) -> None:
    assert fit(shapes, masks / "chair0.png", "--out", tmp_path / "a", "--view", "40", "--no-novelty") == 0
    (entry,) = entries(tmp_path / "a")
    assert entry["views"][0]["azimuth"] == pytest.approx(40, abs=0.01)
    assert entry["views"][0]["posterior"][round(40 / 22.5)] == 1
    np.savez(tmp_path / "known.npz", silhouette=np.ones((2, 16, 16), np.uint8), azimuth=np.array([0.1, 2.0]))
    assert fit(shapes, tmp_path / "known.npz", "--out", tmp_path / "b", "--no-novelty") == 0
    found = [entry["views"][0]["azimuth"] for entry in entries(tmp_path / "b")]
    assert found == pytest.approx([math.degrees(0.1), math.degrees(2.0)], abs=0.1)


def test_pictures_of_something_else_are_warned_of(shapes: Path, tmp_path: Path, capsys) -> None:
    folder = tmp_path / "else"
    folder.mkdir()
    squares = np.pad(np.kron(np.indices((6, 6)).sum(0) % 2, np.ones((8, 8))), 8)  # as on a chessboard
    Image.fromarray((255 * squares).astype(np.uint8)).save(folder / "board.png")
    assert fit(shapes, folder, "--out", tmp_path / "fits") == 0
    (entry,) = entries(tmp_path / "fits")
    assert entry["explained"] is False and "another kind" in entry["why"]
    assert "warning: board is not explained" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, says",
    [
        (["--view", "north"], "--view north: give degrees of azimuth, elevation"),
        (["--light", "ambient"], "only photographs of materials have a light"),
        (["--to", "mtlx"], "--to mtlx: there is no such format"),
        (["--observation", "side"], "the run has no observation 'side'"),
        (["--rate", "0"], "rate=0: must be positive"),
        (["--scale", "2"], "--scale 2: only readings of line integrals are divided by it; leave it out"),
        (["--light", "ambient", "--observation", "top"], "--observation top: --light says how the photographs came"),
    ],
    ids=["view", "light", "format", "observation", "rate", "scale", "both"],
)
def test_mistakes_are_told_in_one_line(shapes: Path, masks: Path, tmp_path: Path, capsys, words, says) -> None:
    assert main(["fit", str(shapes), str(masks), "--out", str(tmp_path / "fits"), *words]) == 2
    said = capsys.readouterr().err
    assert said.startswith("unproject: ") and says in said and said.count("\n") == 1
    assert not (tmp_path / "fits").exists()


def test_paths_that_are_not_there(shapes: Path, tmp_path: Path, capsys) -> None:
    for path in ("gone.png", "gone", "gone.npz"):
        assert main(["fit", str(shapes), str(tmp_path / path), "--out", str(tmp_path / "fits")]) == 2
        assert "check the path" in capsys.readouterr().err
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "diary.txt").write_text("dear diary")
    np.savez(tmp_path / "one.npz", silhouette=np.ones((1, 16, 16), np.uint8))
    assert fit(shapes, tmp_path / "one.npz", "--out", tmp_path / "full", "--no-novelty") == 2
    assert "is not empty and holds no fits" in capsys.readouterr().err


def test_an_image_behind_the_lines_of_a_sinogram(tmp_path: Path) -> None:
    run = tmp_path / "digits"
    flags = ["--channels", "16", "--size", "16", "--batch", "16", "--steps", "3"]
    assert main(["train", "digits", *flags, "--out", str(run), "--quiet"]) == 0
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "scan.npz", sinograms=rng.random((2, 16, 3)) / 2, angle=np.array([0.0, 1.0, 2.0]))
    out = tmp_path / "fits"
    assert fit(run, tmp_path / "scan.npz", "--out", out, "--no-novelty") == 0
    assert [len(entry["views"]) for entry in entries(out)] == [3, 3]
    assert [entry["consistent"] for entry in entries(out)] == [True, True]
    assert fit(run, tmp_path / "scan.npz", "--out", tmp_path / "plain", "--no-novelty", "--no-consistent") == 0
    assert [entry["consistent"] for entry in entries(tmp_path / "plain")] == [False, False]
    with np.load(out / "fit.npz") as arrays:
        assert arrays["image"].shape == (2, 1, 16, 16)


def test_a_material_behind_a_photograph(tmp_path: Path) -> None:
    run, photograph = tmp_path / "wood", tmp_path / "plank.jpg"
    flags = ["--size", "16", "--batch", "2", "--steps", "1"]
    assert main(["train", "wood", *flags, "--out", str(run), "--quiet"]) == 0
    Image.effect_noise((70, 64), 60).convert("RGB").save(photograph)
    out = tmp_path / "fits"
    assert fit(run, photograph, "--out", out, "--light", "directional:0,0", "--view", "0") == 0
    assert list((out / "plank" / "textures").rglob("*.png"))
    assert json.loads((out / "plank" / "textures" / "material.json").read_text())["fresnel"] == "albedo"
    assert fit(run, photograph, "--out", out, "--light", "directional:0,0", "--view", "95") == 2
    with np.load(out / "fit.npz") as arrays:
        assert arrays["diffuse"].shape == (1, 3, 16, 16)


def test_names_with_a_number_sign_are_objects_of_their_own(shapes: Path, masks: Path, tmp_path: Path) -> None:
    folder = tmp_path / "set #2"
    shutil.copytree(masks, folder)
    (folder / "chair0.png").rename(folder / "chair1#1.png")
    assert fit(shapes, folder, "--out", tmp_path / "fits", "--no-novelty") == 0
    assert sorted(entry["name"] for entry in entries(tmp_path / "fits")) == ["chair1", "chair1#1", "chair2"]


def test_pictures_without_a_view_have_none_to_be_given() -> None:
    with pytest.raises(UserError, match="these pictures have no view; leave it out"):
        given_view("3", [])


def test_a_camera_below_the_surface_is_refused() -> None:
    assert given_view("-89", ["view", "jitter"])["view"] < 0 and given_view("95", ["azimuth"])["azimuth"] > 1
    with pytest.raises(UserError, match="the camera must be above the material"):
        given_view("95", ["view", "jitter"])


def test_angles_are_degrees_and_draws_are_no_views() -> None:
    theta = {"view": torch.full((1, 1), math.pi), "perspective": torch.full((1, 1), 0.25), "jitter": torch.ones(1, 1)}
    found = SimpleNamespace(theta=theta)
    assert view_of(found, 0, 0) == {"view": 180.0, "perspective": 0.2}  # pyright: ignore[reportArgumentType]


def test_lines_about_another_center_are_read_as_training_did(tmp_path: Path) -> None:
    """And of two panels with the same directions the first is meant: the other is of pictures whose views are known."""
    rng, run, scan = np.random.default_rng(0), tmp_path / "run", tmp_path / "scan.npz"
    np.savez(scan, sinograms=rng.random((12, 16, 3)) / 2, angle=np.array([0.0, 1.0, 2.0]))
    flags = ["--center", "8", "--views", "predicted", "--bins", "3", "--channels", "16"]
    flags += ["--batch", "4", "--steps", "2", "--quiet"]
    assert main(["train", "digits", "--data", str(scan), "--anchors", str(scan), *flags, "--out", str(run)]) == 0
    assert fit(run, scan, "--out", tmp_path / "fits", "--no-novelty") == 0
    assert len(entries(tmp_path / "fits")) == 12
    assert main(["evaluate", str(run), "--reference", str(scan), "--n", "8"]) == 0


def test_lines_in_another_unit_are_read_as_training_did(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Readings of 50 times the lines' length, and what `evaluate` and `fit` make of them."""
    run, scan = tmp_path / "run", tmp_path / "scan.npz"
    readings = 50 * np.random.default_rng(0).random((4, 16, 3)).astype(np.float32)
    np.savez(scan, sinograms=readings, angle=np.array([0.0, 1.0, 2.0 + math.pi]))  # half a turn on
    flags = ["--bins", "3", "--channels", "16", "--batch", "4", "--steps", "2", "--quiet"]
    assert main(["train", "digits", "--data", str(scan), *flags, "--out", str(run)]) == 0
    opened = load(run)
    panels = opened.recipe().panels
    unit = panels[0].observations[0].projection.unit  # pyright: ignore[reportAttributeAccessIssue]
    assert unit == pytest.approx(100, rel=0.05)
    compared: list[torch.Tensor] = []
    with monkeypatch.context() as patch:
        patch.setattr(Images, "projection_scores", lambda self, y, against, *_: compared.append(against) or {})
        assert main(["evaluate", str(run), "--reference", str(scan), "--n", "8"]) == 0
        opened.evaluate(Collection.lines(scan), n=8)
    compared = [found for found in compared if len(found) == len(readings) * 3]
    assert len(compared) >= 2
    images: list[torch.Tensor] = []
    with monkeypatch.context() as patch:
        patch.setattr(Images, "scores", lambda self, x, against, *_: images.append(against) or {})
        opened.evaluate(torch.full((3, 1, 16, 16), 0.5), n=8)
    assert images[0].max().item() == pytest.approx(0.5 * 16 / unit)  # in the unit of the readings
    viewing = viewing_of(opened.assignments()[0])
    compared.append(observed(opened, [scan], viewing).floats())
    learned = torch.cat([collection.floats() for panel in panels for collection in panel.collections])
    for found in compared:
        torch.testing.assert_close(found.sort(0).values, learned.sort(0).values)
    with pytest.warns(UserWarning, match="largest reading is 49.9 after division by 1, but a row of ones"):
        assert observed(opened, [scan], viewing, 1.0).floats().max() == readings.max()
    with pytest.warns(UserWarning, match="or what to divide them by as --scale"):
        observed(opened, [scan], viewing, 1e5)
    assert fit(run, scan, "--out", tmp_path / "fits", "--no-novelty", "--candidates", "4", "--steps", "1") == 0
    assert entries(tmp_path / "fits")[0]["unit"] == pytest.approx(unit / 16)
    for wrong in ("0", "-1", "nan", "inf"):
        assert fit(run, scan, "--out", tmp_path / "fits", "--scale", wrong) == 2
    for wrong in (tmp_path / "mask.png", tmp_path):
        with pytest.raises(UserError, match="holds no lines, and this run learned from lines"):
            observed(opened, [wrong], viewing)


def test_latents_of_ones_own_are_no_angles() -> None:
    given = given_view("30,2.5", ("azimuth", "distance"))
    assert given == {"azimuth": pytest.approx(math.radians(30)), "distance": 2.5}
    assert given_view("7", ("start",)) == {"start": 7.0}
    with pytest.raises(UserError, match="--view north: give azimuth in degrees, start as it is, with commas between"):
        given_view("north", ("azimuth", "start"))
    theta = {"azimuth": torch.full((1, 1), 0.5), "start": torch.full((1, 1), 26.88)}
    assert view_of(SimpleNamespace(theta=theta), 0, 0) == {"azimuth": 28.6, "start": 26.9}  # pyright: ignore


def test_candidates_that_do_not_fit_in_memory_are_refused(shapes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.training.memory.available_memory", lambda _: 10**8)
    with pytest.raises(
        UserError, match="100000 candidates take about 12.2 GB and 0.1 GB are available; lower candidates"
    ):
        load(shapes).fitter(search=Search(100000))


@pytest.mark.parametrize("gauge", [Gauge(4, False, 16), Gauge(4, True, 16), None])
def test_known_views_are_told_in_the_frame_of_a_run_that_found_its_own(gauge: Gauge | None) -> None:
    """The azimuths of pictures of T F x are those that x is seen from; without a gauge they say nothing."""
    x, azimuth = chairs(3, 16, seed=2).float(), torch.tensor([0.3, 2.0, 4.0])
    seen = Silhouette(size=16)(x if gauge is None else apply(x, gauge), azimuth=azimuth)
    found = Collection(seen, latents={"azimuth": azimuth, "elevation": torch.zeros(3)})
    viewing = Viewing.of(azimuth_bins(16, Silhouette(size=16)))
    frame = Frame("azimuth", gauge)
    if gauge is None:
        with pytest.warns(UserWarning, match="the azimuth beside the pictures is not used: this run found its views"):
            known = known_views(found, viewing, {}, frame)
        assert known is not None and known.keys() == {"elevation"}
        with pytest.raises(UserError, match="the given view cannot be used"):
            known_views(found, viewing, {"azimuth": 0.5}, frame)
        assert known_views(found, viewing, {"elevation": 0.5}, Frame()) != {}
        return
    known = known_views(found, viewing, {}, frame)
    assert known is not None
    torch.testing.assert_close(Silhouette(size=16)(x, azimuth=known["azimuth"]), seen, atol=1e-3, rtol=0)


def test_an_npz_of_another_size_is_taken_and_lines_are_refused(shapes: Path, masks: Path, tmp_path: Path) -> None:
    assert main(["data", "pack", str(masks), "--out", str(tmp_path / "p.npz")]) == 0
    run = load(shapes)
    (state,) = run.assignments()
    found = observed(run, [tmp_path / "p.npz"], viewing_of(state))
    assert found.shape == (1, 16, 16) and 0.05 < found.floats().mean() < 0.6
    np.savez(tmp_path / "lines.npz", sinograms=np.ones((2, 16, 4), np.float32))
    with pytest.raises(UserError, match=r"lines.npz: holds no pictures, and this run learned from silhouettes"):
        observed(run, [tmp_path / "lines.npz"], viewing_of(state))


def test_volumes_and_meshes_are_no_pictures(shapes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "chairs.npz", volumes=chairs(3, 16, seed=5).numpy())
    lines = ("v 0 0 0", "v 1 0 0", "v 0 1 0", "v 0 0 1", "f 1 3 2", "f 1 2 4", "f 1 4 3", "f 2 3 4")
    (tmp_path / "one.obj").write_text("\n".join(lines))
    for name in ("chairs.npz", "one.obj"):
        assert fit(shapes, tmp_path / name, "--out", tmp_path / "fits") == 2
        assert f"{name}: holds volumes, and this run learned from silhouettes; give" in capsys.readouterr().err
    assert not (tmp_path / "fits").exists()


def test_a_fit_that_found_nothing_leaves_its_folder_to_others(shapes: Path, masks: Path, tmp_path: Path) -> None:
    picture, out = masks / "chair0.png", tmp_path / "f"
    assert fit(shapes, picture, "--out", out, "--no-novelty", "--prior", "1e300") == 2
    assert fit(shapes, picture, "--out", out, "--no-novelty") == 0


@pytest.mark.parametrize(("view", "why"), [("1e300", "give degrees of"), ("30,100", "100 degrees is beyond a pole")])
def test_angles_that_are_none_are_refused(view: str, why: str) -> None:
    with pytest.raises(UserError, match=why):
        given_view(view, ["azimuth", "elevation"])


def test_dots_in_names_of_arrays_are_no_suffixes(shapes: Path, tmp_path: Path) -> None:
    np.savez(tmp_path / "m.npz", sil=np.ones((2, 16, 16), bool), names=np.array(["sample_0.25", "sample_0.50"]))
    assert fit(shapes, tmp_path / "m.npz", "--out", tmp_path / "f", "--no-novelty") == 0
    assert {"sample_0.25", "sample_0.50"} <= {path.name for path in (tmp_path / "f").iterdir()}

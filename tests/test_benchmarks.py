"""Benchmarks import, explain themselves, and their smallest parts run."""

from __future__ import annotations

import argparse
import gzip
import json
import subprocess
import sys
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch

import unproject as up
from unproject.data import Collection
from unproject.recipes.shapes import shapes
from unproject.training.recorder import Recorder

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
NAMES = sorted(path.stem for path in BENCHMARKS.glob("*.py") if path.stem != "mitsuba_speed")
"""All but a script that another one starts as a process of its own."""


@pytest.fixture
def named(monkeypatch: pytest.MonkeyPatch) -> object:
    """Import a benchmark by name, as `python benchmarks/NAME.py` finds its neighbours."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 4)
    before = set(sys.modules)
    yield import_module
    for name in set(NAMES) & (set(sys.modules) - before):
        del sys.modules[name]


@pytest.mark.parametrize(
    "name", [name for name in NAMES if name != "mitsuba_speed"]
)  # a script for a process of its own
def test_a_benchmark_imports_and_explains_itself(
    name: str, named: object, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    module: ModuleType = named(name)  # type: ignore[operator]
    assert module.__doc__
    if hasattr(module, "main"):
        monkeypatch.setattr(sys, "argv", [f"{name}.py", "--help"])
        with pytest.raises(SystemExit) as end:
            module.main()
        assert end.value.code == 0 and "usage:" in capsys.readouterr().out


def test_heads_take_a_step(named: object, tmp_path: Path) -> None:
    with Recorder(tmp_path, quiet=True) as recorder:
        trainer = named("heads").trainer(4, tmp_path, recorder)  # type: ignore[operator]
        trainer.step()
    assert trainer.state.counters.step == 1


def test_sooner_trains_until_a_target(named: object, monkeypatch: pytest.MonkeyPatch) -> None:
    sooner = named("sooner")  # type: ignore[operator]
    monkeypatch.setattr(sooner, "CHECK", 0.0)
    recipe = sooner.shapes(views="known", steps=10, batch=4, channels=8, rank=2)
    assert sooner.seconds_to(10.0, recipe, 60.0)[1]


def test_a_material_step_is_timed(named: object) -> None:
    clock = named("material_step").profile(("flash",), argparse.Namespace(size=16, steps=2))  # type: ignore[operator]
    assert {"step", "generator", "projection", "discriminators' update", "rendering"} <= set(clock)
    assert all(len(values) == 2 for values in clock.values())


def test_what_statistics_cost_is_timed(named: object, monkeypatch: pytest.MonkeyPatch) -> None:
    material_step = named("material_step")
    monkeypatch.setattr(material_step, "TURN", 2)
    shares = material_step.statistics_share(argparse.Namespace(size=16, turns=2))  # type: ignore[attr-defined]
    assert len(shares) == 2 and all(share < 1 for share in shares)


def test_photographs_of_exchanged_maps_are_compared(named: object, monkeypatch: pytest.MonkeyPatch) -> None:
    told_apart = named("told_apart")  # type: ignore[operator]
    monkeypatch.setattr(told_apart, "SIZE", 16)
    for score in (told_apart.means, told_apart.covariances):
        heard = told_apart.told_apart("wood", "flash", None, 128, told_apart.exchanges, score)
        assert heard["roughness"] > 1.7 * heard["none"] > 0.7
    found = told_apart.told_apart("wood", "flash", None, 8, told_apart.exchanges)
    assert set(found) == {"none", "diffuse", "specular", "roughness", "normal", "all"}


def test_results_are_kept_with_their_origin(named: object, tmp_path: Path) -> None:
    results = named("results").Results  # type: ignore[operator]
    results(tmp_path / "a" / "results.jsonl", ("class", "seed")).add({"class": "bed", "seed": 0, "mmd": 0.5})
    again = results(tmp_path / "a" / "results.jsonl", ("class", "seed"))
    assert again.has("bed", 0) and not again.has("bed", 1)
    assert again.rows[0]["mmd"] == 0.5 and {"commit", "machine", "torch"} <= set(again.rows[0])


def test_parts_of_a_step_are_timed(named: object, monkeypatch: pytest.MonkeyPatch) -> None:
    step_cost = named("step_cost")  # type: ignore[operator]
    monkeypatch.setattr(step_cost, "PERIOD", 1)
    seconds, rounds = step_cost.turns(16, repeats=1, warm=1, count=4)
    assert set(seconds) == {arm.name for arm in step_cost.ARMS}
    assert all(column.shape == (1, 1) and column.item() > 0 for column in seconds.values())
    assert rounds["as it is"] < rounds["information"]  # only the plain Predicted fits a predictor


def test_shares_of_a_step_are_taken_within_a_turn(named: object) -> None:
    step_cost = named("step_cost")  # type: ignore[operator]
    whole = np.array([[1.0, 3.0], [2.0, 6.0]])
    seconds = {"as it is": whole, "both": 0.8 * whole, "float32": 1.25 * whole}
    table = step_cost.step_table(32, seconds, {"as it is": 0.5, "information": 3.5})
    assert "| both | 2.400 | 20.0% | 20.0%, 20.0% | at most 10%: MISSED |" in table
    slow = np.array([[1.0, 1.0], [1.0, 1.0], [9.0, 1.0]])  # other work, in one step
    assert step_cost.share(slow, np.full((3, 2), 0.9)) == pytest.approx(0.1)
    assert "spare 10.0% of a run" in table and "In float32 a step takes 3.750 s, 1.25 times the time" in table
    looks = {"tilted, any": 2.0, "photographs, absorption": 3.5}
    aslant = {name: {"level_seconds": 1.0, "tilted_seconds": ratio, "ratio": ratio} for name, ratio in looks.items()}
    silhouettes = step_cost.silhouette_table({"any": {"released_seconds": 12.0, "ratio": 12.0}, **aslant})
    assert "12.0 times as fast | 15: MISSED" in silhouettes and "| tilted, any | level | 2.00 times the" in silhouettes
    assert "| photographs, absorption | level | 3.50 times the time | 3: MISSED |" in silhouettes


def test_mitsuba_sees_every_texel() -> None:
    pytest.importorskip("mitsuba")
    code = (
        "import mitsuba as mi, numpy as np; mi.set_variant('scalar_rgb'); from mitsuba_speed import scene;"
        "places = mi.load_dict({'type': 'aov', 'aovs': 'place:uv'});"
        "seen = np.array(mi.render(scene(4, 3), integrator=places, spp=64))[..., :2];"
        "print(len(np.unique(np.floor(seen * [12, 4]).reshape(-1, 2), axis=0)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=BENCHMARKS, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "48"


def test_results_of_other_budgets_are_not_taken(named: object, tmp_path: Path) -> None:
    results = named("results")  # type: ignore[operator]
    (tmp_path / "results.jsonl").write_text(
        '{"class": "bed", "seed": 0, "minutes": 19.9}\n'
    )  # before budgets were kept
    kept = results.Results(tmp_path / "results.jsonl", ("class", "seed", "budget"))
    assert not kept.has("bed", 0, 20.0) and results.budget_of(kept.rows[0]) == 19.9
    kept.add({"class": "bed", "seed": 0, "budget": 20.0, "minutes": 20.1})
    again = results.Results(tmp_path / "results.jsonl", ("class", "seed", "budget"))
    assert again.has("bed", 0, 20.0) and not again.has("bed", 0, 5.0)
    assert [results.budget_of(row) for row in again.rows] == [19.9, 20.0]


@pytest.mark.parametrize("name", ["any_class", "forms", "digits"])
def test_arms_of_another_budget_are_trained(
    name: str, named: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module: ModuleType = named(name)  # type: ignore[operator]
    taken: list[object] = []
    scores = dict.fromkeys(("mmd_ratio", "mmd_of_hulls", "cov_ratio", "cov_of_hulls", "in_one_piece", "mmd"), 1.0)
    scores |= dict.fromkeys(("frechet", "recall", "frechet_turned", "precision_turned", "recall_turned", "steps"), 1.0)
    monkeypatch.setattr(module, "run_arm", lambda *arm: taken.append(arm) or scores)
    monkeypatch.setattr(module, "count_cpu_seconds", lambda: None)
    monkeypatch.setattr(module, "prepare", lambda *about: tmp_path, raising=False)
    words = ["--out", str(tmp_path / "out"), "--seeds", "0"]
    words += {"any_class": ["--classes", "bed", "--forms", "known"], "forms": ["--classes", "mug"], "digits": []}[name]
    if name == "digits":
        mnist(tmp_path, 60)
        monkeypatch.setattr(module, "scored", lambda *_: (None, scores))
        words += ["--arms", "direct"]
    words += [] if name == "forms" else ["--data", str(tmp_path)]
    budgets = [["--minutes", "1"], ["--minutes", "2"], ["--minutes", "1"]]
    budgets += [["--minutes", "1", "--shapes", "7"]] if name == "any_class" else []
    for budget in budgets:
        monkeypatch.setattr(sys, "argv", [name, *words, *budget])
        module.main()
    assert len(taken) == len(budgets) - 1
    rows = [json.loads(line) for line in (tmp_path / "out" / "results.jsonl").read_text().splitlines()]
    assert [row["budget"] for row in rows if row.get("budget")][:2] == [1.0, 2.0]
    assert name == "forms" or capsys.readouterr().out.count("| 2 |")


def test_pictures_of_other_numbers_of_shapes_lie_apart(
    named: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    any_class = named("any_class")  # type: ignore[operator]
    volumes = up.data.chairs(8, any_class.RENDERED)
    monkeypatch.setattr(any_class, "volumes_of", lambda name, data, shapes: (volumes[:shapes], volumes[6:]))
    folders = [any_class.prepare("chair", tmp_path, tmp_path, shapes) for shapes in (2, 3)]
    assert [len(torch.load(folder / "truth.pt")["train"]) for folder in folders] == [2, 3]
    names = {any_class.name_of("chair", shapes, "known", minutes, 0) for shapes in (2, 3) for minutes in (5.0, 20.0)}
    assert len(names) == 4


def mnist(folder: Path, count: int) -> np.ndarray:
    """Write idx files of pictures that are all different, and return those of training."""
    rng = np.random.default_rng(0)
    made = [rng.integers(0, 256, (count, 28, 28), dtype=np.uint8) for _ in range(2)]
    for part, pictures in zip(("train", "t10k"), made, strict=True):
        head = bytes([0, 0, 8, 3]) + np.array(pictures.shape, ">u4").tobytes()
        (folder / f"{part}-images-idx3-ubyte.gz").write_bytes(gzip.compress(head + pictures.tobytes()))
    return made[0]


def test_anchors_are_neither_trained_on_nor_scored_with(named: object, tmp_path: Path) -> None:
    digits = named("digits")  # type: ignore[operator]
    images = mnist(tmp_path, 70)
    rest, anchors = digits.set_apart(tmp_path / digits.TRAINING, tmp_path)
    assert digits.set_apart(tmp_path / digits.TRAINING, tmp_path) == (rest, anchors)
    kept = digits.read_idx(rest)
    every, trained = {image.tobytes() for image in images}, {image.tobytes() for image in kept}
    assert len(kept) == 20 and trained < every
    apart = Collection.images(tmp_path / digits.TRAINING, digits.SIZE).floats()[
        [k for k, image in enumerate(images) if image.tobytes() not in trained]
    ]
    with np.load(anchors) as stored:
        angle, lines = torch.from_numpy(stored["angle"]), torch.from_numpy(stored["lines"])
    assert torch.allclose(up.LineIntegral(digits.SIZE)(apart, angle=angle)[:, 0], lines, atol=1e-5)


def test_images_that_others_are_tuned_on_are_not_scored(named: object, tmp_path: Path) -> None:
    fit_images = named("fit_images")  # type: ignore[operator]
    x = np.arange(80, dtype=np.uint8)[:, None, None] * np.ones((1, 32, 32), np.uint8)
    np.savez(tmp_path / "x.npz", x=x)
    for n, first in ((60, 20), (100, 20), (10, 70)):
        tuned, scored = fit_images.images_of(tmp_path / "x.npz", n)
        assert (tuned.amax((1, 2, 3)) * 255).round().tolist() == list(range(20))
        assert (scored.amax((1, 2, 3)) * 255).round().tolist() == list(range(first, 80))
    np.savez(tmp_path / "few.npz", x=x[:20])
    with pytest.raises(SystemExit, match="holds 20 images"):
        fit_images.images_of(tmp_path / "few.npz", 5)


def test_birds_leave_no_masks_among_their_results(
    named: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    birds = named("birds")  # type: ignore[operator]
    less = {"size": 16, "bins": 4, "channels": 8, "rank": 2, "rounds": 1, "batch": 8, "steps": 1}
    monkeypatch.setattr(birds, "shapes", lambda **flags: shapes(data=flags["data"], **less))
    np.savez(tmp_path / "masks.npz", sil=discs(24))
    words = ["--data", str(tmp_path / "masks.npz"), "--runs", str(tmp_path / "run"), "--out", str(tmp_path / "out")]
    birds.main([*words, "--size", "16"])
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"shapes.webp", "birds.json"}
    assert not [path for path in (tmp_path / "run").rglob("*views*") if path.suffix in (".webp", ".png")]


@pytest.fixture
def loss_logs(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(BENCHMARKS.parent / "tools"))
    return import_module("loss_logs")


def test_loss_logs_are_compared_if_there_are_any(
    loss_logs: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = tmp_path / "before", tmp_path / "after"
    assert loss_logs.compare(before, after) == 1 and "hold no logs" in capsys.readouterr().out
    for folder in (before, after):
        folder.mkdir()
        (folder / "digits-0.jsonl").write_text("{}")
    assert loss_logs.compare(before, after) == 0
    (after / "wood-0.jsonl").write_text("{}")
    assert loss_logs.compare(before, after) == 1
    assert f"wood-0: MISSING in {before}" in capsys.readouterr().out
    (before / "wood-0.jsonl").write_text("[]")
    assert loss_logs.compare(before, after) == 1 and "wood-0: DIFFERENT" in capsys.readouterr().out


def test_trainings_that_fail_are_counted(
    loss_logs: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(loss_logs, "ARMS", {"digits": "", "wood": ""})
    monkeypatch.setattr(loss_logs, "train", lambda folder, name, seed: "killed" if name == "wood" else "")
    assert loss_logs.record(tmp_path) == 2 and "wood-1: killed" in capsys.readouterr().out


def discs(count: int) -> np.ndarray:
    """Ellipses of several widths, 32 pixels a side."""
    y, x = np.mgrid[-1:1:32j, -1:1:32j]  # type: ignore[misc]
    return np.stack([(x / width) ** 2 + (y / 0.7) ** 2 < 1 for width in np.linspace(0.3, 0.7, count)])


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make `shapes` so small that it trains in a second, whatever the minutes."""
    less = {"size": 16, "bins": 4, "channels": 8, "rank": 2, "rounds": 1, "batch": 8, "steps": 2}
    made = {"shapes": lambda **flags: shapes(**{**{k: v for k, v in flags.items() if k != "minutes"}, **less})}
    monkeypatch.setattr("unproject.recipes.find", made.__getitem__)


def test_real_masks_become_folders_and_pictures(named: object, small: None, tmp_path: Path) -> None:
    (tmp_path / "silhouettes").mkdir()
    labels = {"label": np.arange(24) % 2, "classnames": np.array(["car side", "chair"])}
    np.savez(tmp_path / "silhouettes" / "caltech101_28.npz", sil=discs(24), **labels)
    real_masks, masks = named("real_masks"), named("masks")  # type: ignore[operator]
    found = masks.SOURCES["car_side"].masks(tmp_path)
    assert np.array_equal(found, discs(24)[::2])
    folder = masks.write_folder(found, tmp_path / "data" / "car_side")
    assert len(list(folder.glob("*.png"))) == 12 and masks.write_folder(found[:1], folder) == folder
    run = up.train(up.recipes.find("shapes")(data=folder), tmp_path / "run", quiet=True)
    (tmp_path / "run" / "verdict.json").write_text('{"word": "good", "line": "good: all"}')
    row = real_masks.result_of(run.path, tmp_path, "car_side")
    assert {"verdict", "steps", "minutes", "in_one_piece", "distance", "distance_ratio", "views_used"} <= set(row)
    assert {p.stem for p in tmp_path.glob("*.png")} == {f"car_side-{k}" for k in ("shapes", "pictures", "views")}
    assert "| car_side | 12 | 2 |" in real_masks.table([{"class": "car_side", "pictures": 12, **row}])


def test_real_masks_are_trained_with_default_flags(
    named: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real_masks = named("real_masks")  # type: ignore[operator]
    called: list[list[str]] = []

    def refuse(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        called.append(command)
        return subprocess.CompletedProcess(command, 2, "", "unproject: too dark\n")

    monkeypatch.setattr(real_masks.subprocess, "run", refuse)
    assert real_masks.train(tmp_path / "pictures", tmp_path / "run", 5.0, 1) == "unproject: too dark"
    data, out = str(tmp_path / "pictures"), str(tmp_path / "run")
    assert called[0][3:] == ["train", "shapes", "--data", data, "--minutes", "5", "--out", out, "--threads", "1"]


def test_verdicts_judge_runs_of_their_own(named: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    verdicts = named("verdicts")  # type: ignore[operator]
    monkeypatch.setattr(verdicts, "STEPS", 2)
    monkeypatch.setattr(verdicts, "SHAPES", 8)
    (birds,) = [case for case in verdicts.CASES if case.name == "birds"]
    found = verdicts.row(birds, tmp_path)
    assert found["word"] == "failed" and found["truth"] > verdicts.GOOD
    assert "1 of 1 right" in verdicts.table([found])


def test_minutes_hold_masks_out_and_draw_curves(named: object, small: None, tmp_path: Path) -> None:
    (tmp_path / "silhouettes").mkdir()
    np.savez(tmp_path / "silhouettes" / "bird_cub_aves_64.npz", sil=discs(24))
    minutes = named("minutes")  # type: ignore[operator]
    found = minutes.birds_arm("predicted", 0, 1.0, tmp_path, tmp_path)
    assert found["held_out"] == 6 and found["distance_ratio"] > 0 and found["steps"] == 2
    key = {"class": "birds", "views": "predicted", "seed": 0}
    rows = [{**key, **found, "budget": 5.0}, {**key, **found, "budget": 10.0, "distance_ratio": 1.5}]
    assert minutes.qualities(rows)["birds"]["predicted"][10.0] == 1.5
    assert "1.50 (2)" in minutes.table(rows).splitlines()[-1]
    assert minutes.curves(minutes.qualities(rows)).size == (minutes.WIDTH, minutes.HEIGHT)


def test_minutes_train_on_volumes_and_silhouettes(named: object, small: None, tmp_path: Path) -> None:
    minutes = named("minutes")  # type: ignore[operator]
    folder, x = tmp_path / "data" / "chair-200", up.data.chairs(12, 32)
    folder.mkdir(parents=True)
    torch.save({"azimuth": torch.linspace(0, 6, 24), "train": x[:8], "test": x[8:]}, folder / "truth.pt")
    np.savez(folder / "plain.npz", sil=discs(24))
    (folder / "ceiling-plain.json").write_text("0.5")  # else a predictor is trained for it
    direct, predicted = (minutes.chairs_arm(v, 0, 1.0, tmp_path, tmp_path) for v in ("direct", "predicted"))
    assert direct["steps"] == 2 and direct["mmd_ratio"] > 0 and "views" not in direct
    assert predicted["views_of_ceiling"] == predicted["views_exact"] / 0.5
    assert minutes.chairs_arm("direct", 0, 1.0, tmp_path, tmp_path) == direct  # the run that is there


def test_budgets_count_cpu_seconds_if_asked_to(named: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that waits spends nothing of its budget."""
    trainer, recovery = import_module("unproject.training.trainer"), import_module("unproject.training.recovery")
    for module in (trainer, recovery):
        monkeypatch.setattr(module, "time", module.time)
    named("results").count_cpu_seconds()  # type: ignore[operator]
    with Recorder(tmp_path, quiet=True) as recorder:
        one = named("heads").trainer(4, tmp_path, recorder)  # type: ignore[operator]
        time.sleep(0.5)
        one.record(event="waited")
    assert one.state.counters.seconds < 0.4


def test_a_training_that_was_stopped_is_no_result(named: object, tmp_path: Path) -> None:
    finished = named("results").finished  # type: ignore[operator]
    run = up.Run(tmp_path, up.networks.LowRankGenerator(size=16, channels=8, rank=2), 3, up.Volumes(), complete=False)
    with pytest.raises(SystemExit, match="stopped after step 3"):
        finished(run)
    done = replace(run, complete=True)
    assert finished(done) is done


@pytest.mark.filterwarnings("ignore:.*skipped, the first.* empty")
def test_many_masks_are_measured_against_few(named: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    million = named("million")  # type: ignore[operator]
    for name, value in {"SIZE": 16, "VOXELS": 16, "SIDES": 2, "TURNS": 1, "EACH": 1}.items():
        monkeypatch.setattr(million, name, value)
    less = {"bins": 4, "channels": 8, "rank": 2, "rounds": 2, "batch": 8}
    monkeypatch.setattr(million, "shapes", lambda **flags: shapes(**flags, **less))
    many, few = (million.write_array(tmp_path / f"{n}.npy", n) for n in (40, 20))
    masks = np.load(many)
    assert masks.shape == (40, 16, 16) and masks.dtype == np.uint8 and masks.max() == 255
    assert len(np.unique(masks.reshape(40, -1), axis=0)) > 30
    found = million.arm(many, 40, 1)
    assert found["first_step"]["seconds"] > 0 and len(found["rounds"]) == 1 and found["memory"]["end"]["anonymous"] > 0
    assert million.speeds(many, few, 40)["steps_a_second_of_few"] > 0


def test_what_processes_send_is_counted(named: object, monkeypatch: pytest.MonkeyPatch) -> None:
    processes = named("processes")  # type: ignore[operator]
    for name in ("all_reduce", "broadcast"):
        monkeypatch.setattr(processes.dist, name, lambda tensor: tensor.zero_())
    counter = processes.Counter()
    processes.dist.all_reduce(torch.ones(3))
    processes.dist.broadcast(torch.ones(2, dtype=torch.int8))
    assert counter.read()[:2] == [2, 14]
    monkeypatch.setattr(processes, "WARM", 0)
    assert processes.steps(1, 16, 8, 8, None)["cpu_seconds"] > 0


def test_materials_with_and_without_matching_are_compared(
    named: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "--out",
        str(tmp_path),
        "--data",
        "plastic",
        "--weights",
        "0",
        "2",
        "--steps",
        "1",
        "--size",
        "16",
        "--n",
        "20",
    ]
    for _ in range(2):  # the second time all arms are there
        named("matching").main(words)  # type: ignore[operator]
        lines = (tmp_path / "results.jsonl").read_text(encoding="utf-8").splitlines()
        assert len(lines) == 2 and capsys.readouterr().out.count("| plastic |") == 2
    assert (tmp_path / "plastic-2-3-0.png").is_file()


def test_wood_by_minutes_is_scored_as_in_the_figure(
    named: object, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    module = named("wood_minutes")  # type: ignore[operator]
    monkeypatch.setattr("unproject.reproduce.material_sources.MATERIALS", 20)
    monkeypatch.setattr(module, "scored", lambda domain: 20)
    monkeypatch.setattr(module, "flags_of", lambda arm, budget: {"size": 16, "steps": 1, "maps": 8, **arm.flags})
    for _ in range(2):  # the second time the arm is there
        module.main(["--out", str(tmp_path), "--minutes", "1", "--arms", "wood-joint"])
        (line,) = (tmp_path / "results.jsonl").read_text(encoding="utf-8").splitlines()
        assert "| wood-joint | 0 | 1 (1) |" in capsys.readouterr().out
    assert json.loads(line)["correlation_error"] > 0 and (tmp_path / "wood-joint-1-0.png").is_file()

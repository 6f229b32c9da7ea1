"""Reports are made of stored results alone."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from unproject._types import UserError
from unproject.reproduce import Arm, Claim, Figure, Report, write, write_summary
from unproject.reproduce.claim_results import ClaimResult
from unproject.reproduce.figure import Spread
from unproject.reproduce.result import Result

FIGURE = Figure(
    "fig7",
    "A <title>",
    "What is claimed.",
    "What is said.",
    arms=(Arm("ours", "wood", "wood", "many"), Arm("theirs", "wood", "wood", "one")),
    claims=(Claim("nearer", "ours", "theirs", ("far",)), Claim("unknown", "ours", "theirs", ("absent",))),
    extra_scores={"kinds": "more"},
    deviations=("It is small.",),
)
MADE = {
    "command": ["unproject", "train", "wood"],
    "commit": "abc1234",
    "started": "2026-11-22T01:02:03+00:00",
    "processor": "x86_64",
    "cpus": 2,
    "threads": 1,
    "cuda": None,
}


def stored(folder: Path, arm: str, seed: int, value: float) -> Result:
    one = Result(folder, arm, seed)
    score = {"value": value, "protocol": "p", "n": 1, "seed": 0}
    scores = {"far": score, "kinds": score | {"value": 3.0}}
    content = {"arm": arm, "seed": seed, "steps": 5, "seconds": 60.0, "environment": MADE, "scores": scores}
    one.file.write_text(json.dumps(content))
    with Image.new("RGB", (30, 20), "red") as picture:
        picture.save(one.picture)
    return one


@pytest.fixture
def report(tmp_path: Path) -> Report:
    values = {("ours", 0): 1.0, ("ours", 1): 1.1, ("theirs", 0): 2.0, ("theirs", 1): 2.1}
    return Report(FIGURE, {key: stored(tmp_path, *key, value) for key, value in values.items()})


def test_a_report_has_claims_scores_and_provenance(report: Report, tmp_path: Path) -> None:
    assert [one.verdict for one in report.claim_results] == ["holds", "undecided"] and report.verdict == "undecided"
    paths = write(report, tmp_path / "out")
    assert {path.name for path in paths} == {"fig7.md", "fig7.html", "fig7.webp"}
    text = (tmp_path / "out" / "fig7.md").read_text()
    parts = ("What is claimed.", "What is said.", "holds", "not measured", "abc1234", "It is small.")
    for part in (*parts, "| ours 1.05, theirs 2.05 | 2.00, 1.91 |"):
        assert part in text
    assert "| ours | 1.0, 1.0 | 1.05 (1, 1.1) |  | 3 (3, 3) |" in text and "- far, less is better: p\n" in text
    with Image.open(tmp_path / "out" / "fig7.webp") as picture:
        assert picture.size == (72, 42)


def test_pictures_that_are_too_many_for_a_row_go_on_below(
    report: Report, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("unproject.reproduce.pictures.WIDEST", 50)
    write(report, tmp_path)
    with Image.open(tmp_path / "fig7.webp") as picture:
        assert picture.size == (30, 84)


def test_training_images_of_real_collections_are_not_joined(report: Report, tmp_path: Path) -> None:
    real = Arm("theirs", "wood", "wood", "one")
    for result in report.results.values():
        result.picture.rename(result.views)  # as stored before they were left out
    shown = replace(report, figure=replace(FIGURE, arms=FIGURE.arms[:1], real=(real,), claims=(), shows="views"))
    write(shown, tmp_path / "out")
    with Image.open(tmp_path / "out" / "fig7.webp") as picture:
        assert picture.size == (30, 42)


def test_the_page_needs_no_other_file(report: Report, tmp_path: Path) -> None:
    write(report, tmp_path)
    page = (tmp_path / "fig7.html").read_text()
    assert "A &lt;title&gt;" in page and "<title>A &lt;" in page
    assert "many (<code>wood</code>)" in page and "<em>Margin</em>" in page and "`" not in page
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert sources and all(source.startswith("data:image/webp;base64,") for source in sources)
    assert "http" not in page


def test_the_summary_has_every_claim(report: Report, tmp_path: Path) -> None:
    other = replace(FIGURE, name="fig9", deviations=("It is small.", "It is square."))
    write_summary([report, Report(other, {})], tmp_path / "all.md", "pages/")
    text = (tmp_path / "all.md").read_text()
    assert text.count("| nearer |") == 2 and text.count("2.00, 1.91") == 1 and text.count("| not measured |") == 3
    assert "[Fig. 7](pages/fig7.md)" in text and text.count("| ours | ") == 2
    assert (
        "- Figs. 7, 9: It is small.\n- Fig. 9: It is square.\n" in text
        and "Eq. 5" in text
        and "650" in text
        and "η" in text
    )


def test_the_summary_lists_the_arms_with_the_papers_recipe_or_says_why_there_are_none(
    report: Report, tmp_path: Path
) -> None:
    arms = (Arm("a-paper", "wood-paper", "wood", "one"), Arm("b-paper", "wood-paper", "wood", "other"))
    stored(tmp_path, "a-paper", 0, 1.0)
    papers = Report(replace(FIGURE, arms=arms, claims=()), {("a-paper", 0): Result(tmp_path, "a-paper", 0)})
    without = Report(replace(FIGURE, name="fig8", no_paper_arm="Too far."), {})
    write_summary([papers, without], tmp_path / "all.md")
    text = (tmp_path / "all.md").read_text()
    assert "| Fig. 7 | a-paper (1 seed), b-paper (not trained yet) | `wood-paper` |" in text
    assert "| Fig. 8 | none | Too far. |" in text
    write(without, tmp_path)
    assert "No arm has the paper's recipe: Too far." in (tmp_path / "fig8.md").read_text()


def test_arms_of_other_protocols_are_named(report: Report, tmp_path: Path) -> None:
    other = report.results["theirs", 1]
    content = other.read()
    content["scores"]["far"]["protocol"] = "q"
    other.file.write_text(json.dumps(content))
    write(report, tmp_path)
    assert "- far, less is better: p (ours, theirs); q (theirs)\n" in (tmp_path / "fig7.md").read_text()


def test_a_report_of_nothing_is_undecided(tmp_path: Path) -> None:
    report = Report(FIGURE, {})
    paths = write(report, tmp_path)
    assert report.verdict == "undecided" and {path.suffix for path in paths} == {".md", ".html"}


def test_what_is_beyond_the_paper_does_not_decide_its_figure(report: Report) -> None:
    ours = replace(report.figure.claims[0], beyond_paper=True)
    papers = Claim("farther", "theirs", "ours", ("far",))
    both = Report(replace(FIGURE, claims=(ours, papers)), report.results)
    assert [one.verdict for one in both.claim_results] == ["holds", "does not hold"] and both.verdict == "does not hold"
    assert both.claim_results[0].text == "Beyond the paper: nearer"


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ((0.9, 0.8), "holds (t(4) = 2.4, p = 0.037)"),
        ((0.5, 0.1), "undecided (t(4) = 0.849, p = 0.22; all seeds in favour)"),
        ((-0.5, -0.1), "undecided (t(4) = -0.849, p = 0.22; no seed in favour)"),
        ((0.5, -0.1), "undecided (t(4) = 0.566, p = 0.3; seeds disagree)"),
        ((0.5,), "undecided"),
        ((), "undecided"),
    ],
)
def test_what_is_undecided_may_lean(effects: tuple[float, ...], said: str) -> None:
    assert ClaimResult(FIGURE.claims[0], effects, Spread(0.25, 4)).verdict_text == said


def test_claims_say_in_what_else_their_arms_differ(report: Report) -> None:
    def rewritten(arm: str, seed: int, **changed: object) -> ClaimResult:
        one = report.results[arm, seed]
        one.file.write_text(json.dumps(one.read() | changed))
        return Report(FIGURE, report.results).claim_results[0]

    assert report.claim_results[0].unlike == ()
    rewritten("ours", 0, seconds=150.0)
    assert rewritten("ours", 1, seconds=150.0).verdict_text.endswith("; 2.5 times the minutes)")
    both = rewritten("theirs", 0, environment=MADE | {"commit": "def5678"})
    assert both.unlike == ("seeds of several commits", "other commits", "2.5 times the minutes")
    undecided = replace(both, effects=(0.5, -0.1), spread=Spread(0.25, 4)).verdict_text
    assert undecided.endswith("; seeds disagree; seeds of several commits; other commits; 2.5 times the minutes)")
    rewritten("ours", 0, environment=MADE | {"commit": "def5678"})
    both = rewritten("theirs", 1, environment=MADE | {"threads": 2})
    assert both.unlike == ("seeds of several commits", "other machines", "2.5 times the minutes")
    rewritten("ours", 0, environment=MADE)
    ours_alone = {key: found for key, found in report.results.items() if key[0] == "ours"}
    assert Report(FIGURE, ours_alone).claim_results[0].unlike == ()


def test_the_spread_is_that_of_all_arms_and_twice_that_between_two(report: Report) -> None:
    ours, theirs = math.log(1.1 / 1.0) ** 2 / 2, math.log(2.1 / 2.0) ** 2 / 2
    spread = report.claim_results[0].spread
    assert (spread.variance, spread.freedom) == (pytest.approx(ours + theirs), 2)
    number = (
        Report(replace(FIGURE, claims=(Claim("small", "ours", "", ("far",)),)), report.results).claim_results[0].spread
    )
    assert number.variance == pytest.approx((ours + theirs) / 2)


def test_arms_of_another_collection_do_not_move_a_claim(report: Report, tmp_path: Path) -> None:
    other = {
        ("photographs", seed): stored(tmp_path, "photographs", seed, value) for seed, value in ((0, 0.01), (1, 9.0))
    }
    figure = replace(FIGURE, real=(Arm("photographs", "wood", "wood-real", "real"),))
    assert Report(figure, report.results | other).claim_results == report.claim_results
    alike = replace(FIGURE, real=(Arm("photographs", "wood", "wood", "more of it"),))
    assert Report(alike, report.results | other).claim_results[0].verdict == "undecided"


def test_claims_against_true_things(report: Report, tmp_path: Path) -> None:
    truth = stored(tmp_path, "truth-wood", 0, 0.5)
    figure = replace(FIGURE, claims=(Claim("near", "ours", "truth-wood", ("far",), factor=1 / 4),))
    near = Report(figure, report.results, {"truth-wood": truth})
    assert near.claim_results[0].effects == pytest.approx((math.log(2), math.log(4 * 0.5 / 1.1)))
    assert "| truth-wood |  | 0.5 |" in markdown(near, tmp_path)


def test_claims_about_real_collections_count_where_there_are_results(report: Report) -> None:
    real = Arm("photographs", "wood", "wood", "real")
    claims = (FIGURE.claims[0], Claim("of real ones", "photographs", "ours", ("far",)))
    judged = Report(replace(FIGURE, real=(real,), claims=claims), report.results).claim_results
    assert [one.claim.text for one in judged] == ["nearer"]


def markdown(report: Report, folder: Path) -> str:
    write(report, folder)
    return (folder / "fig7.md").read_text()


@pytest.mark.parametrize("content", ['{"scores": {"far": {"value": NaN}}}', '{"steps": 1, "scores": {}}', "{"])
def test_what_is_not_whole_is_damaged(report: Report, content: str) -> None:
    report.results["ours", 0].file.write_text(content)
    with pytest.raises(UserError, match="damaged"):
        report.results["ours", 0].read()


@pytest.mark.parametrize("seconds", ["NaN", "9" * 400])
def test_seconds_that_no_report_can_divide_are_damaged(report: Report, seconds: str) -> None:
    one = report.results["ours", 0]
    one.file.write_text(one.file.read_text().replace('"seconds": 60.0', f'"seconds": {seconds}'))
    with pytest.raises(UserError, match="ours-0.json: damaged"):
        one.read()


def test_seeds_that_one_arm_lacks_do_not_count(report: Report) -> None:
    fewer = Report(FIGURE, {key: value for key, value in report.results.items() if key != ("theirs", 1)})
    assert len(fewer.claim_results[0].effects) == 1 and fewer.claim_results[0].verdict == "undecided"


def test_damaged_results_are_named(report: Report) -> None:
    report.results["ours", 0].file.write_text('{"scores": {"far": 3}}')
    with pytest.raises(UserError, match="ours-0.json: damaged .*remove it"):
        _ = report.claim_results

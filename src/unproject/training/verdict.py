"""Verdict: whether a run came out well, why, and what to do next, from a few dozen samples.

Assignments judge views, domains judge samples and their projections (`findings` of each); the worst finding decides.
"""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import torch
from torch import Tensor

from .._random import generator_at
from ..assignment import AssignmentState, Panel
from ..data.splitting import RENDERED
from ..domains import Domain
from ..domains.evidence import MIN_PICTURES, Evidence, few_finding
from ..metrics import WORDS, Finding, Score, Word, worst
from ..networks import Generator
from .fitting import by_name

SAMPLES, VIEWS_EACH, REAL, AT_ONCE = 64, 4, 512, 32
"""Samples, projections of each, held-out pictures at most, and samples projected at once."""
NEAR, MOST_NEAR = 64, 0.125
"""Training pictures this close in their collection's order, and at most this share, may show the same object."""
SAID = 2
"""Findings that the line of a bad verdict names."""
VIEWED = 128
"""Pictures that views are judged by, at least: to those held out training pictures are added."""


@dataclass(frozen=True)
class Verdict:
    """The word on a run, from the findings.

    Examples:
        >>> from unproject.metrics import Finding, Score
        >>> share = Score(0.2, "share of volumes in one piece", n=64)
        >>> whole = Finding("pieces", share, 0.7, 0.3, "20% of shapes are in one piece", "train longer")
        >>> Verdict((whole,)).line
        'failed: 20% of shapes are in one piece; next: train longer'
    """

    findings: tuple[Finding, ...]

    @property
    def word(self) -> Word:
        return worst(self.findings)

    @property
    def line(self) -> str:
        """The verdict in one line: all that is good, or what is worst and what to do next."""
        if not self.findings:
            return f"nothing was judged: that takes {MIN_PICTURES} pictures of a kind and others to compare them with"
        if self.word == "good":
            return "good: " + ", ".join(finding.says for finding in self.findings)
        bad = [finding for finding in self.findings if finding.word == self.word]
        return f"{self.word}: {'; '.join(finding.says for finding in bad[:SAID])}; next: {bad[0].advice}"

    def scores(self) -> dict[str, Score]:
        """Return each finding's score as `verdict_NAME`, and as `verdict` 2 if good, 1 if doubtful, 0 if failed."""
        if not self.findings:
            return {}
        value = float(len(WORDS) - 1 - WORDS.index(self.word))
        first = self.findings[0].score
        whole = Score(value, self.line, max(finding.score.n for finding in self.findings), first.seed)
        return {"verdict": whole} | {f"verdict_{f.name}": f.score for f in self.findings}

    def described(self) -> dict[str, object]:
        """Return what verdict.json holds."""
        return {"word": self.word, "line": self.line, "findings": {f.name: _described(f) for f in self.findings}}


def _described(finding: Finding) -> dict[str, object]:
    levels = {"doubtful": finding.doubtful, "failed": finding.failed if math.isfinite(finding.failed) else None}
    score, advice = finding.score, finding.advice if finding.word != "good" else ""
    judged: dict[str, object] = {"word": finding.word, "value": score.value, **levels}
    return {**judged, "says": finding.says, "next": advice, "protocol": score.protocol}


@torch.no_grad()
def judge(generator: Generator, domain: Domain, assignments: Sequence[AssignmentState], seed: int = 0) -> Verdict:
    """Judge a run by samples and by their projections against held-out pictures; draws from no global state."""
    x = generator.sample(SAMPLES, seed)
    findings = []
    kinds = by_name(assignments)
    for of, state in kinds.items():
        found = panel_findings(domain, state, x, seed)
        if len(kinds) > 1:
            found = [replace(f, name=f"{f.name}_{of}", says=f"{of}: {f.says}") for f in found]
        findings += found
    observations = [o for state in assignments for o in state.panel.observations]
    return Verdict((*findings, *domain.open_findings(observations, seed), *domain.findings(x, seed)))


def panel_findings(domain: Domain, state: AssignmentState, x: Tensor, seed: int) -> list[Finding]:
    """Judge one panel by samples x; that it has too few pictures is doubtful, whatever else may be good."""
    seen = evidence(state, x, seed)
    if not seen.is_enough:
        return [few_finding(seen, seed)]
    every = seen.real if state.panel.held_out is None else torch.cat([seen.real, seen.others])  # each once
    found = state.findings(every[: max(VIEWED, len(seen.real))], seen.generated) + domain.picture_findings(seen, seed)
    shares = state.view_shares(every)
    if shares is not None:
        found += domain.side_findings(state.panel.observations, shares, state.fixes_gauge)
    return found


def evidence(state: AssignmentState, x: Tensor, seed: int) -> Evidence:
    """Return held-out pictures, training pictures of other objects, and as many projections of samples x."""
    panel, rng = state.panel, generator_at(seed, 0, "verdict")
    real, rows = held_out_images(panel, seed)
    others = torch.randperm(len(panel), generator=rng)[: SAMPLES * VIEWS_EACH]
    trained_on = panel.held_out is None
    apart = ~(are_near(panel, rows, others) if trained_on else held_out_near(panel, rows, others))
    count = max(1, round(apart.float().sum(1).mean().item()))
    views = state.draw_views(count, rng)
    turns = zip((torch.arange(count) % len(x)).split(AT_ONCE), views.split(AT_ONCE), strict=True)
    generated = torch.cat([state.observe(x[which], some, rng) for which, some in turns])
    known = state.views if trained_on else state.held_out_heads
    return Evidence(
        generated,
        views,
        real,
        known[rows].long() if state.fixes_gauge else None,
        panel.batch(others),
        apart,
        panel.projection.silhouettes,
    )


def held_out_images(panel: Panel, seed: int) -> tuple[Tensor, Tensor]:
    """Return pictures that were held out, or else training pictures, and their rows."""
    count = len(panel if panel.held_out is None else panel.held_out)
    rows = torch.randperm(count, generator=generator_at(seed, 0, "held out"))[:REAL]
    return panel.batch(rows) if panel.held_out is None else panel.held_out.batch(rows), rows


def held_out_near(panel: Panel, rows: Tensor, others: Tensor) -> Tensor:
    """Return (R, O), whether a held-out row was near a training row in the order of their collection.

    Blocks of at most 16 neighbours are held out, of whose object there may be further pictures. Where names tell the
    object (`data.splitting`), or are in no order, none counts as near.
    """
    assert panel.held_out is not None
    names = panel.collections[0].names
    unknown = len(panel.collections) > 1 or any(RENDERED.search(name) for name in names)
    if unknown or any(a > b for a, b in pairwise(names)):
        return torch.zeros(len(rows), len(others), dtype=torch.bool)
    places = torch.tensor([bisect(names, panel.held_out.names[row]) for row in rows.tolist()])
    return (places[:, None] - others[None]).abs() <= min(NEAR, MOST_NEAR * len(panel))


def are_near(panel: Panel, rows: Tensor, others: Tensor) -> Tensor:
    """Return (R, O), whether two rows are near in the order of their collections: those may show the same object."""
    ends = torch.tensor([len(collection) for collection in panel.collections]).cumsum(0)
    lengths = ends.diff(prepend=torch.zeros(1, dtype=torch.long))

    def place(rows: Tensor) -> Tensor:
        which = torch.bucketize(rows, ends, right=True)
        return (rows - ends[which] + lengths[which]) / lengths[which]

    near = min(NEAR / len(panel), MOST_NEAR)
    return (place(rows)[:, None] - place(others)[None]).abs() <= near

"""Card: README.md of a shared run, a model card of the hub: what it makes, its scores, where it comes from.

References:
    Mitchell et al. 2019, Model cards for model reporting.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..training import Run
from ..training.building import foreign_code
from ..training.environment import typed_command
from ..training.run_directory import VERDICT

CARD = "README.md"
TAGS = {"volume": "image-to-3d", "image": "unconditional-image-generation", "maps": "unconditional-image-generation"}
"""Tasks of the hub, by the domain."""
MAKES = {"volume": "3-D shapes", "image": "images", "maps": "surface materials"}


def card_of(run: Run, folder: Path, title: str) -> str:
    """Return the card of a run whose recipe.json, environment.json and verdict.json lie in a folder."""
    recipe, environment, verdict = (_read(folder / name) for name in ("recipe.json", "environment.json", VERDICT))
    makes = MAKES.get(run.domain.name, f"samples ({run.domain.name})")
    parts = [
        _front(run),
        f"# {title}",
        f"A generator of {makes}, learned from unpaired projections by unproject, "
        f"recipe `{recipe.get('recipe') or 'of its own'}`, {run.step:,} steps.",
        _picture(folder),
        "## Use",
        _use(run, foreign_code(folder)),
        "## Scores",
        _scores(verdict),
        "## Where it comes from",
        _provenance(recipe, environment),
        "## What it is not for",
        "It makes what its training pictures hold, and knows nothing else. What no picture shows is invented. "
        "It cannot be trained on: discriminators and optimisers are not part of it.",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _use(run: Run, foreign: Sequence[str]) -> str:
    trust = ", trust=True" if foreign else ""
    code = (
        f'```python\nimport unproject as up\n\nrun = up.from_pretrained("OWNER/NAME"{trust})  # or a folder\n'
        f"x = run.sample(8, seed=1)  # {tuple(run.sample(1).shape[1:])} each\n```"
    )
    needs = f"It needs code that is not in it, and has to be importable: `{'`, `'.join(foreign)}`."
    return f"{code}\n\n{needs}" if foreign else code


def _read(file: Path) -> dict[str, Any]:
    return _mapping(json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {})


def _mapping(found: Any) -> dict[str, Any]:
    """An object of a file, which somebody may have changed; nothing where it holds something else."""
    return found if isinstance(found, dict) else {}


def _front(run: Run) -> str:
    task = TAGS.get(run.domain.name)
    lines = ["library_name: unproject", *([f"pipeline_tag: {task}"] if task else []), "tags:", "- unproject", "- gan"]
    return "\n".join(["---", *lines, "---"])


def _picture(folder: Path) -> str:
    found = sorted((folder / "samples").glob("*.png"))
    return f"![samples, none picked](samples/{found[-1].name})" if found else ""


def _scores(verdict: Mapping[str, Any]) -> str:
    if not verdict:
        return "None were measured."
    found = {name: _mapping(finding) for name, finding in _mapping(verdict.get("findings")).items()}
    rows = [f"| {name} | {_value(f)} | {f.get('word', '')} | {f.get('protocol', '')} |" for name, f in found.items()]
    table = "\n".join(["| finding | value | | how it is measured |", "|---|---|---|---|", *rows]) if rows else ""
    return f"Verdict: {verdict.get('line', '')}\n\n{table}".strip()


def _value(finding: Mapping[str, Any]) -> str:
    value = finding.get("value")
    return f"{value:.3g}" if isinstance(value, (int, float)) else ""


def _provenance(recipe: Mapping[str, Any], environment: Mapping[str, Any]) -> str:
    arguments = _mapping(recipe.get("arguments"))
    data = arguments.get("data") or "the recipe's own, procedural or embedded"
    data = data.get("path", data) if isinstance(data, dict) else data
    command = typed_command(environment)
    rows = {
        "data": data,
        "command": f"`{command}`" if command else None,
        "seed": arguments.get("seed"),
        "begun": environment.get("started"),
        "commit": environment.get("commit"),
        "versions": ", ".join(f"{k} {v}" for k, v in _mapping(environment.get("packages")).items() if v),
        "machine": environment.get("processor"),
    }
    return "\n".join(["| | |", "|---|---|", *(f"| {k} | {v} |" for k, v in rows.items() if v not in (None, ""))])

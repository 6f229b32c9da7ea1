"""`unproject demo`: the main job on the embedded chairs."""

from __future__ import annotations

import shlex
import time
from pathlib import Path

from .._types import UserError
from ._machine import warn_if_empty
from ._report import leave_report
from ._threads import use_threads
from ._verdict import conclude


def run(*, out: Path = Path("demo"), minutes: float = 8.0, seed: int = 0, threads: int | None = None) -> None:
    """Learn chairs from 16000 unlabelled silhouettes, without views or shapes, on this machine.

    Writes into --out: silhouettes.png (the data), chairs.png (a contact sheet of new chairs), turntable.gif,
    glb/shape_NN.glb for Blender or any viewer, and run/, the run directory. Ends with the run's verdict in one line.
    Ctrl-C stops the training, which `unproject resume OUT/run` continues; new chairs are then made by `export`.

    Args:
        out: where to put it all.
        minutes: of training.
        seed: of everything random.
        threads: processor threads (default: one a core that nobody else keeps busy).
    """
    from .. import export
    from ..recipes.shapes import shapes
    from ..training import train

    use_threads(threads)
    if (out / "run").exists():
        raise UserError(f"{out}: holds a demo already; remove it, or choose another --out")
    began = time.monotonic()
    print(f"Rendering unlabelled silhouettes of a family of chairs, then training for {minutes:g} minutes.")
    recipe = shapes(minutes=minutes, seed=seed)
    masks = recipe.panels[0].collections[0].items
    out.mkdir(parents=True, exist_ok=True)
    export.silhouette_sheet(masks[:: max(len(masks) // 64, 1)][:64], out / "silhouettes.png")
    trained = train(recipe, out / "run")
    if not trained.complete:  # what half a training makes would pass for the demo's result
        path = shlex.quote(str(out / "run"))
        then = f"unproject export {path} --to glb --out {shlex.quote(str(out / 'glb'))}"
        print(f"{out}: stopped; unproject resume {path} goes on, then {then}")
        return
    chairs = trained.sample(16, seed=1, largest_part=True)
    export.contact_sheet(chairs[:8], path=out / "chairs.png")
    written = "chairs.png"
    if trained.domain.empty(chairs).all():
        warn_if_empty(trained.domain, chairs)
    else:
        export.turntable(chairs, out / "turntable.gif")
        trained.domain.write(chairs, "glb", out / "glb")
        written += ", turntable.gif, glb/"
    conclude(trained, quiet=False)
    leave_report(trained, quiet=False)
    print(f"{out}: {written} after {(time.monotonic() - began) / 60:.1f} minutes")

"""The command `unproject VERB ...`: one module a verb.

A verb's module has a function `run`: its positional-only parameters are the verb's arguments, its
keyword-only ones the flags, its docstring the help; it returns the exit status, None meaning 0.
A verb whose flags depend on its arguments has `parse(argv)` instead, which returns what to call.
Nothing here imports torch before a verb needs it.
"""

from __future__ import annotations

import gc
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from io import TextIOWrapper

from .._objects import nearest
from .._parent import stop_with_parent
from .._types import UserError, is_lack_of_memory
from ._errors import explain
from ._processes import PATIENCE, let_others_speak, lost_another
from ._threads import begin_to_measure
from ._warnings import held

VERBS = {
    "demo": "learn chairs from unlabelled silhouettes, in minutes on a laptop",
    "train": "train a recipe on a collection of projections",
    "resume": "continue a run",
    "sample": "draw samples from a run into an .npz file",
    "evaluate": "score a run against held-out data, or check it by itself",
    "report": "write a page about a run: verdict, samples, curves, data, commands",
    "studio": "look at runs in a browser, while they train too",
    "export": "write samples as meshes, pictures, turntables or material maps",
    "share": "write a run for others, or send it to the Hugging Face Hub, with a model card",
    "fit": "find the shape, material or image behind given pictures",
    "render": "render the maps of a material under natural, directional, coloured or ambient light",
    "reproduce": "train and score the arms of a figure of the paper, or print its networks",
    "recipes": "list the recipes, or show one",
    "check": "test a projection, prior, observation or generator of your own against the laws",
    "data": "see what a collection is read as, pack a folder, or fetch a public collection",
}
"""Verb → one line of help. Its module is `unproject.cli.VERB`."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status: 0, 2 for a user's mistake, 130 for Ctrl-C."""
    try:
        if argv is not None:
            return _run(list(argv))
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")  # names of files may be no text
        stop_with_parent()
        with held():
            return _run(sys.argv[1:])
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (UserError, OSError) as error:
        let_others_speak()
        print(f"unproject: {explain(error)}", file=sys.stderr)
        return 2
    except (MemoryError, RuntimeError) as error:
        if lost_another(error):
            time.sleep(2 * PATIENCE)  # the agent ends this process meanwhile
            print("unproject: another process of this run has ended; its own line says why", file=sys.stderr)
            return 2
        if not is_lack_of_memory(error):
            raise
        print("unproject: memory is used up; ask for fewer or smaller samples, or a smaller --batch", file=sys.stderr)
        return 2


def _run(argv: list[str]) -> int:
    # Threads that spin while they wait take the cores from whatever else runs; those that sleep at once are woken so
    # late that two are no faster than one. GNU's spin for some tenths of a millisecond here, others sleep.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("GOMP_SPINCOUNT", "20000")
    begin_to_measure()
    if not argv or argv[0] in ("-h", "--help", "help"):
        print(usage())
        return 0
    if argv[0] == "--version":
        from unproject import __version__

        print(f"unproject {__version__}")
        return 0
    with uncollected():
        call = _parsed(argv[0], argv[1:])
    return 0 if call is None else (call() or 0)


@contextmanager
def uncollected() -> Iterator[None]:
    """Look for no garbage while torch and the package are imported: a sixth of that time would go into finding none."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _parsed(verb: str, argv: list[str]) -> Callable[[], int | None] | None:
    """What to call for a verb and its arguments, or None if they asked for help, which has been printed."""
    if verb not in VERBS:
        meant = f". Perhaps you meant 'data {verb}'" if verb in ("inspect", "pack", "get") else nearest(verb, VERBS)
        raise UserError(f"there is no verb {verb!r}{meant}; `unproject --help` lists them")
    from ._arguments import HelpPrinted, bind

    module = import_module(f"unproject.cli.{verb}")
    try:
        return module.parse(argv) if hasattr(module, "parse") else bind(verb, argv, module.run)[0]
    except HelpPrinted:
        return None


def usage() -> str:
    """What `unproject --help` prints."""
    verbs = "\n".join(f"  {verb:<9} {line}" for verb, line in VERBS.items())
    return (
        "usage: unproject VERB ...\n\n"
        "Learn generators of shapes, images and materials from collections of their projections.\n\n"
        f"verbs:\n{verbs}\n\n"
        "`unproject VERB --help` tells more. Angles on the command line are in degrees."
    )

"""The command's manners: exit statuses, and exactly one line for every user error."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from types import ModuleType

import pytest

import unproject
from unproject import cli
from unproject._types import UserError

Verb = Callable[..., int | None]


@pytest.fixture
def verb(monkeypatch: pytest.MonkeyPatch) -> Callable[[Verb], None]:
    """Plug a function in as the verb `try`."""

    def plug(run: Verb) -> None:
        module = ModuleType("unproject.cli.try")
        module.run = run  # type: ignore[attr-defined]
        monkeypatch.setitem(cli.VERBS, "try", "a verb of this test")
        monkeypatch.setitem(sys.modules, "unproject.cli.try", module)

    return plug


def raising(error: BaseException) -> Verb:
    def run() -> None:
        raise error

    return run


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What stderr holds: one line that begins with `unproject: `."""
    err = capsys.readouterr().err
    assert err.startswith("unproject: ") and err.endswith("\n") and err.count("\n") == 1, err
    return err.removeprefix("unproject: ").strip()


def test_help_of_data_lists_its_actions(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["data", "--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"\n  {action} " in text for action in ("inspect", "pack", "get"))


@pytest.mark.parametrize("argv", [[], ["--help"], ["-h"], ["help"]])
def test_help_lists_every_verb(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(argv) == 0
    text = capsys.readouterr().out
    assert all(f"  {verb} " in text and line in text for verb, line in cli.VERBS.items())


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"unproject {unproject.__version__}\n"


def test_the_nearest_verb_is_suggested(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["trian", "shapes"]) == 2
    assert "Perhaps you meant 'train'" in one_line(capsys)


def test_a_verb_unlike_any_other(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--frobnicate"]) == 2
    assert "Perhaps" not in one_line(capsys)


SAYS_HOW_THREADS_WAIT = """
import os, sys
from unproject import cli
cli.main(["--help"])
assert "torch" not in sys.modules, "its threads have read how to wait"
print(os.environ["OMP_WAIT_POLICY"], os.environ["GOMP_SPINCOUNT"])
"""


@pytest.mark.parametrize("given, found", [({}, "PASSIVE 20000"), ({"GOMP_SPINCOUNT": "0"}, "PASSIVE 0")])
def test_threads_are_told_how_to_wait_before_there_are_any(given: dict[str, str], found: str) -> None:
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("OMP_", "GOMP_"))}
    said = subprocess.check_output([sys.executable, "-c", SAYS_HOW_THREADS_WAIT], env=clean | given, text=True)
    assert said.splitlines()[-1] == found


@pytest.mark.parametrize("returned, status", [(None, 0), (0, 0), (1, 1)])
def test_a_verbs_result_is_the_exit_status(verb, returned: int | None, status: int) -> None:
    verb(lambda: returned)
    assert cli.main(["try"]) == status


def test_a_users_mistake_is_one_line(verb, capsys: pytest.CaptureFixture[str]) -> None:
    verb(raising(UserError("masks/: empty;\n  put pictures there")))
    assert cli.main(["try"]) == 2
    assert one_line(capsys) == "masks/: empty; put pictures there"


@pytest.mark.parametrize(
    "number, fix",
    [
        (errno.ENOSPC, "free some space"),
        (errno.EACCES, "change its permissions"),
        (errno.EROFS, "can be written"),
        (errno.ENOENT, "check the path"),
        (errno.ENOTDIR, "a part of this path is a file"),
        (errno.EISDIR, "name a file"),
        (errno.ENODEV, "try again"),
    ],
)
def test_the_systems_refusal_is_one_line(verb, number: int, fix: str, capsys: pytest.CaptureFixture[str]) -> None:
    verb(raising(OSError(number, "No such luck", "runs/a")))
    assert cli.main(["try"]) == 2
    line = one_line(capsys)
    assert line.startswith("runs/a: No such luck; ") and fix in line


@pytest.mark.parametrize("error", [OSError("cannot read\nthis"), OSError(errno.EIO, "bad disk"), OSError()])
def test_a_refusal_without_a_path_is_one_line(verb, error: OSError, capsys: pytest.CaptureFixture[str]) -> None:
    verb(raising(error))
    assert cli.main(["try"]) == 2
    assert one_line(capsys)


def test_ctrl_c_is_quiet(verb, capsys: pytest.CaptureFixture[str]) -> None:
    verb(raising(KeyboardInterrupt()))
    assert cli.main(["try"]) == 130
    assert capsys.readouterr().err == ""


def test_a_bug_of_ours_is_not_hidden(verb) -> None:
    verb(raising(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        cli.main(["try"])


def test_a_closed_pipe_is_quiet() -> None:
    code = "import sys; from unproject.cli import main; sys.stdout.flush(); sys.exit(main(['--help']))"
    done = subprocess.run(["bash", "-c", f'"{sys.executable}" -uc "{code}" | true'], capture_output=True, text=True)
    assert done.stderr == ""


def test_the_module_is_the_command() -> None:
    done = subprocess.run([sys.executable, "-m", "unproject", "trian"], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("unproject: ") and done.stderr.count("\n") == 1

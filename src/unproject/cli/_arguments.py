"""Typed function signatures become the command line.

`bind("sample", argv, run)` reads `argv` by the signature of `run`: positional-only parameters are
arguments, the others flags, and the `Args:` section of the docstring is their help. Given several
functions it reads the union of their parameters; a parameter that two functions share is one flag with
the default and the help of the first. That is how a recipe's own parameters become flags of
`unproject train`.
"""

from __future__ import annotations

import dataclasses
import inspect
import io
import math
import os
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import docstring_parser
import tyro

from .._objects import find_object
from .._types import UserError
from ._machine import busy
from ._mistakes import in_one_line, plainly

_SCALARS = (bool, int, float, str, Path)


class HelpPrinted(Exception):
    """The arguments asked for help, and it has been printed."""


def bind(verb: str, argv: Sequence[str], *functions: Callable[..., Any], skip: int = 0) -> list[partial]:
    """Read `argv` by the signatures of `functions`; the same functions with their arguments filled in.

    The first `skip` parameters of the last function, its only positional ones then, are left for the caller to give.

    Raises:
        UserError: if `argv` does not fit; the message names the nearest flag.
        HelpPrinted: if `argv` asks for help.
    """
    signatures = [_flags(function, skip if function is functions[-1] else 0) for function in functions]
    options = _options(functions, signatures)
    values = _read(verb, argv, options)
    return [_filled(function, signature, values) for function, signature in zip(functions, signatures, strict=True)]


def bind_recipe(
    verb: str,
    argv: Sequence[str],
    run: Callable[..., Any],
    *,
    first: Callable[[str, Mapping[str, Any]], object] | None = None,
) -> Callable[[], Any]:
    """Read `RECIPE --flags` for `run(recipe, /, *, ...)`: flags of the recipe's function, of `Recipe` and of `run`.

    RECIPE is a built-in name, `module:function` or `path/to/file.py:function`. What is returned makes the recipe, by
    calling its function with the flags it takes and setting the other fields, and hands it to `run`. `first` is called
    before that with RECIPE and all flags, to refuse what needs no data to be refused.
    """
    if argv and not argv[0].startswith("-"):
        factory = find_recipe(argv[0])
        own, options, go = bind(f"{verb} {argv[0]}", argv[1:], factory, recipe_options(factory), run, skip=1)

        def call() -> Any:
            from unproject.training import make

            given = {**own.keywords, **options()}
            if first is not None:
                first(argv[0], {**given, **go.keywords})
            with busy("reading the data"):
                recipe = make(argv[0], factory, given)
            return go(recipe)

        return call
    if {"-h", "--help"} & set(argv):
        print(f"`unproject {verb} RECIPE --help` adds the recipe's own flags; `unproject recipes` lists them.\n")
        bind(f"{verb} RECIPE", ["--help"], run, skip=1)
    raise UserError(f"{verb}: name a recipe first: `unproject {verb} shapes ...`; `unproject recipes` lists them")


def recipe_options(factory: Callable[..., Any]) -> Callable[..., dict[str, Any]]:
    """Return a function whose parameters are the fields of `Recipe` that are flags of every recipe.

    Those that the recipe's own function takes are left to it. It returns what was given; None and False mean nothing.
    """
    from unproject.training import Options, Recipe

    taken = {p.name for p in inspect.signature(factory).parameters.values() if p.kind is not p.VAR_KEYWORD}
    kinds = {**typing.get_type_hints(Options), "seed": int}
    text = docstring_parser.parse(inspect.getdoc(Recipe) or "")

    def options(**given: Any) -> dict[str, Any]:
        return {name: value for name, value in given.items() if value is not None and value is not False}

    free = {name: bool if kind is bool else kind | None for name, kind in kinds.items() if name not in taken}
    vars(options)["__signature__"] = inspect.Signature(
        [
            inspect.Parameter(
                name, inspect.Parameter.KEYWORD_ONLY, default=False if kind is bool else None, annotation=kind
            )
            for name, kind in free.items()
        ]
    )
    shown = "\n".join(f"    {p.arg_name}: {' '.join((p.description or '').split())}" for p in text.params)
    options.__doc__ = f"Set fields of the recipe.\n\nArgs:\n{shown}\n"
    return options


def find_recipe(name: str) -> Callable[..., Any]:
    """The function that makes the recipe: a built-in name, `module:function` or `path/to/file.py:function`."""
    if ":" not in name:
        from unproject import recipes

        return recipes.find(name)
    found = find_object(name)
    if not (inspect.isroutine(found) or inspect.isclass(found) or isinstance(found, partial)):
        kind = type(found).__name__
        raise UserError(f"{name} is no recipe but of type {kind}: name a function that returns an unproject.Recipe")
    return found


def _flags(function: Callable[..., Any], skip: int) -> dict[str, inspect.Parameter]:
    """The parameters of a function that the command line can give, with their annotations resolved."""
    parameters = list(inspect.signature(function).parameters.values())[skip:]
    parameters = [p for p in parameters if p.kind is not p.VAR_KEYWORD]
    kinds = _resolved(function, {p.name: p.annotation for p in parameters if p.annotation is not p.empty})
    found = {}
    for p in parameters:
        kind = kinds.get(p.name, str if p.default is p.empty else type(p.default))
        if _speakable(kind):
            found[p.name] = p.replace(annotation=kind)
        elif p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD):
            raise UserError(f"{_name(function)}: the command line cannot give {p.name!r} ({kind}); give it a default")
    return found


def _resolved(function: Callable[..., Any], annotations: dict[str, Any]) -> dict[str, Any]:
    plain = inspect.unwrap(function.func if isinstance(function, partial) else function)
    holder = type("holder", (), {"__annotations__": annotations})
    return typing.get_type_hints(holder, globalns=getattr(plain, "__globals__", {}), include_extras=True)


def _speakable(kind: Any) -> bool:
    """Whether a value of this type can be typed on a command line."""
    origin = typing.get_origin(kind)
    if origin is Literal:
        return True
    if origin is Annotated:
        return _speakable(typing.get_args(kind)[0])
    if origin in (typing.Union, types.UnionType, tuple, list):
        return all(_speakable(part) for part in typing.get_args(kind) if part not in (..., type(None)))
    return kind in _SCALARS or (isinstance(kind, type) and (issubclass(kind, Enum) or dataclasses.is_dataclass(kind)))


def _options(functions: Sequence[Callable[..., Any]], signatures: Sequence[dict[str, Any]]) -> type:
    """A dataclass with one field a parameter, which tyro reads."""
    fields: dict[str, tuple[str, Any, Any]] = {}
    for function, signature in zip(functions, signatures, strict=True):
        text = docstring_parser.parse(inspect.getdoc(function) or "")
        help_of = {p.arg_name: " ".join((p.description or "").split()) for p in text.params}
        for name, p in signature.items():
            fields.setdefault(name, (name, _annotated(p, help_of.get(name, "")), _field(p)))
    options = dataclasses.make_dataclass("Options", list(fields.values()))
    options.__doc__ = _description(functions[0])
    return options


def _annotated(p: inspect.Parameter, text: str) -> Any:
    positional = p.kind is p.POSITIONAL_ONLY
    # A flag named like a word of Python's, --for, is a parameter `for_`.
    name = p.name[:-1] if p.name.endswith("_") else None
    # tyro would add "(default: None)" to a help that says what None means, "(default: True)" to --no-mirror.
    hint = "" if p.default is None or isinstance(p.default, bool) else None
    text = f"turn off: {text}" if p.default is True and text else text  # the flag is --no-NAME
    named: dict[str, Any] = {} if hint is None else {"help_behavior_hint": hint}
    shown = p.name.upper() if positional else None
    argument = tyro.conf.arg(name=name, help=text or None, metavar=shown, **named)
    kind = Annotated[_without_none(p), argument]
    return tyro.conf.Positional[kind] if positional else kind


def _without_none(p: inspect.Parameter) -> Any:
    """`T | None = None` read as plain T: None means that the flag was left out, nobody types it."""
    parts = [part for part in typing.get_args(p.annotation) if part is not type(None)]
    choices = typing.get_args(parts[0]) if len(parts) == 1 and typing.get_origin(parts[0]) is Literal else ()
    if p.default is not None or len(parts) != 1 or not (choices or parts[0] in (int, float, str, Path)):
        return p.annotation
    read = str if choices else parts[0]
    spec = tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=f"{{{','.join(choices)}}}" if choices else read.__name__.upper(),
        choices=tuple(choices) or None,
        instance_from_str=lambda words: read(words[0]),
        is_instance=lambda value: value is None or isinstance(value, read),
        str_from_instance=lambda value: [str(value)],
    )
    return Annotated[p.annotation, spec]


def _field(p: inspect.Parameter) -> Any:
    if p.default is p.empty:
        return dataclasses.field(kw_only=True)
    return dataclasses.field(default_factory=lambda: p.default, kw_only=True)


def _description(function: Callable[..., Any]) -> str:
    text = docstring_parser.parse(inspect.getdoc(function) or "")
    return "\n\n".join(part for part in (text.short_description, text.long_description) if part)


def _read(verb: str, argv: Sequence[str], options: type) -> dict[str, Any]:
    _check_empty(verb, argv)
    said = io.StringIO()
    try:
        with redirect_stderr(said), _wide_unless_asked_for_help(argv):
            read = tyro.cli(options, args=list(argv), prog=f"unproject {verb}", config=(tyro.conf.FlagCreatePairsOff,))
    except SystemExit as end:
        if not end.code:
            raise HelpPrinted from None
        wrong = plainly(in_one_line(said.getvalue()), [_spelling(field) for field in dataclasses.fields(options)])
        raise UserError(f"{verb}: {wrong} (`unproject {verb} --help`)") from None
    values = {field.name: getattr(read, field.name) for field in dataclasses.fields(read)}
    for name, value in values.items():
        _check_number(name, value)
    return values


@contextmanager
def _wide_unless_asked_for_help(argv: Sequence[str]) -> Iterator[None]:
    """Keep tyro from breaking the lines of a mistake, and long words, at the terminal's width."""
    before = os.environ.get("COLUMNS")
    if not {"-h", "--help"} & set(argv):
        os.environ["COLUMNS"] = "10000"
    try:
        yield
    finally:
        os.environ.pop("COLUMNS", None)
        os.environ.update({} if before is None else {"COLUMNS": before})


def _check_empty(verb: str, argv: Sequence[str]) -> None:
    """Refuse an empty argument: as a path it would be the current folder, and no flag means anything by it."""
    for before, word in zip([verb, *argv], argv, strict=False):
        flag, equals, value = word.partition("=")
        if not word or (flag.startswith("--") and equals and not value):
            what = flag or (before if before.startswith("--") else "an argument")
            raise UserError(f"{verb}: {what} is empty; is a variable of the shell not set?")


def _check_number(name: str, value: Any) -> None:
    """Refuse what no flag of ours can mean, nor any of a user's recipe that is to be written into recipe.json."""
    for number in value if isinstance(value, (tuple, list)) else (value,):
        if isinstance(number, (int, float)) and not abs(number) < (math.inf if isinstance(number, float) else 2**63):
            wanted = "a finite number" if isinstance(number, float) else "a whole number below 2^63"
            raise UserError(f"--{name.rstrip('_').replace('_', '-')} {number}: give {wanted}")


def _spelling(field: dataclasses.Field[Any]) -> str:
    on = field.default_factory is not dataclasses.MISSING and field.default_factory() is True
    return ("no-" if on else "") + field.name.rstrip("_").replace("_", "-")


def _filled(function: Callable[..., Any], signature: dict[str, inspect.Parameter], values: dict[str, Any]) -> partial:
    positional = [values[name] for name, p in signature.items() if p.kind is p.POSITIONAL_ONLY]
    named = {name: values[name] for name, p in signature.items() if p.kind is not p.POSITIONAL_ONLY}
    return partial(function, *positional, **named)


def _name(function: Any) -> str:
    return getattr(function, "__name__", type(function).__name__)

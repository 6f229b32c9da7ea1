"""Which file of a texture set is which map, found by the words of its name.

Words are separated by _ - . and spaces, by digits, or by a capital after a small letter, in any case:
`Wood027_1K_NormalGL.jpg` says wood, 027, 1, k, normal, gl. What is written in one word or in two, as BaseColor,
DirectX and Normal_Map are, is one. The last word that names a map decides, so that
`painted_metal_rough_1k.png` is a roughness map. The short words `metal` and `rough` also name materials: they count
only after the words that all pictures of the folder begin with, which are its name. A letter at the end, as in
`T_Planks_D.png`, stands for a map in a set with `T_Planks_N.png`.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from os.path import commonprefix
from pathlib import Path

from ..._files import is_file_or_broken_link
from ..._types import UserError
from .pictures import UNREAD

SUFFIXES = (".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".webp", ".bmp")
WORDS = {
    "colour": ("color", "colour", "albedo", "basecolor", "basecolour", "diffuse", "diff", "col", "bc"),
    "roughness": ("roughness", "rough"),
    "metallic": ("metallic", "metalness", "metal"),
    "glossiness": ("glossiness", "gloss", "smoothness"),
    "specular": ("specular", "spec"),
    "reflection": ("reflection", "refl"),
    "normal": ("normal", "normals", "nor", "norm", "nrm", "normalgl", "normaldx"),
    "height": ("height", "displacement", "disp", "bump"),
    "packed": ("arm", "orm"),
    "unused": ("ao", "occlusion", "opacity", "mask", "emission", "emissive", "preview", "thumb"),
}
ROLE_OF = {word: role for role, words in WORDS.items() for word in words}
LETTERS = {
    "d": "diffuse",
    "r": "roughness",
    "m": "metallic",
    "g": "glossiness",
    "s": "specular",
    "n": "normal",
    "h": "height",
    "a": "opacity",
    "e": "emissive",
    "o": "occlusion",
}
"""A letter that ends a name, and the word that it stands for."""
PACKED = ({"roughness", "metallic"}, {"roughness", "metalness"})  # side by side, as glTF packs them
WITH_ALPHA = ("metallic", "specular")
"""Maps whose alpha may be the glossiness, as in MetallicSmoothness (Unity) and specularGlossiness (glTF)."""
ROUGH = ("roughness", "packed", "glossiness", *(f"{role}_glossiness" for role in WITH_ALPHA))
WEAK = ("metal", "rough", "gloss", "refl")
UP = ("gl", "opengl", "ogl", "normalgl")  # green up the picture
DOWN = ("dx", "directx", "normaldx")  # green down
MAP_WORDS = {*ROLE_OF, *UP, *DOWN}
IN_TWO = {
    ("direct", "x"): "directx",
    ("open", "gl"): "opengl",
    ("base", "color"): "basecolor",
    ("base", "colour"): "basecolour",
    ("ambient", "occlusion"): "occlusion",
    **{(word, "map"): word for word in ROLE_OF},
}
"""Words that are written in two as well."""
LOOKED_FOR = "; ".join(f"{role}: {', '.join(words)}" for role, words in WORDS.items() if role != "unused")
LOOKED_FOR += f"; or, where one ends in N, by the letters {', '.join(LETTERS).upper()} at their ends"


@dataclass(frozen=True)
class Textures:
    """The files of a material.

    Attributes:
        files: role → file, for colour, roughness, glossiness or packed, and of the others those that are there.
        down: whether the normal map's green points down the picture (DirectX).
    """

    files: dict[str, Path]
    down: bool = False

    def file_of(self, role: str) -> Path:
        """The file that has this map, be it in its colours or in its alpha."""
        return self.files.get(role) or next(file for name, file in self.files.items() if role in name.split("_"))


def words_of(name: str) -> list[str]:
    """The words of a file's name without its suffix, of any script, in small letters; case parts them too."""
    name = unicodedata.normalize("NFC", name)  # some systems take letters apart from their accents
    kinds = "".join(map(_kind, name))
    words: list[str] = []
    for match in re.finditer(r"A+(?!a)|A?a+|x+|0+", kinds):
        word = name[match.start() : match.end()].lower()
        joined = IN_TWO.get((words[-1], word)) if words else None
        words[-1:] = [joined] if joined else [*words[-1:], word]
    return words


def _kind(sign: str) -> str:
    """A or a for a letter of either case, x for one that has none, 0 for a digit, else a blank."""
    if sign.isdecimal():
        return "0"
    return " " if not sign.isalpha() else "A" if sign.isupper() else "a" if sign.islower() else "x"


def words_of_all(files: Sequence[Path]) -> list[list[str]]:
    """The words of each name, with the word that a letter at its end stands for in a set that has a normal map by it.

    Without one `mug_d.png` and `mug_r.png` are two mugs; beside `mug_x.png` they are mugs too.
    """
    words = [words_of(file.stem) for file in files]
    letters: dict[tuple[str, ...], set[str]] = {}
    with_colour = set()
    for said in words:
        before, last = _name_and_last(said)
        if len(last) == 1 and role_of(said, len(said)) is None:
            letters.setdefault(before, set()).add(last)
        elif role_of(said, len(said)) == "colour":
            with_colour.add(tuple(word for word in before if word not in MAP_WORDS))
    spelt = {
        before
        for before, own in letters.items()
        if "n" in own <= LETTERS.keys() and ("d" in own or before in with_colour)
    }
    return [_spelt(said) if _name_and_last(said)[0] in spelt else said for said in words]


def _name_and_last(words: list[str]) -> tuple[tuple[str, ...], str]:
    """The words before the last, and the last before a resolution such as 2K or 1024."""
    end = len(words) - 2 * (words[-1:] == ["k"])
    end -= end == len(words) > 0 and len(words[-1]) in (3, 4) and words[-1].isdecimal()
    return (tuple(words[: end - 1]), words[end - 1]) if end > 0 else ((), "")


def _spelt(words: list[str]) -> list[str]:
    before, last = _name_and_last(words)
    return [*before, LETTERS[last], *words[len(before) + 1 :]] if last in LETTERS else words


def picture_names(folder: Path) -> list[Path]:
    """The pictures that lie in a folder, sorted; hidden ones are none."""
    files = (f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith("."))
    return sorted(f for f in files if is_file_or_broken_link(f))


def unread_maps(folder: Path) -> list[Path]:
    """The files in a folder that are named as maps and of a format that is not read, sorted."""
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in {*UNREAD} - {*SUFFIXES} and f.is_file())
    return [file for file in files if role_of(words_of(file.stem)) is not None]


def holds_material(folder: Path) -> bool:
    """Whether pictures in this folder are named as two maps of a material."""
    return len(candidates(folder).keys() - {"unused"}) > 1


def sets_in(folder: Path) -> dict[str, list[Path]]:
    """Return the texture sets that lie side by side in a folder, name → files: nothing unless there are several.

    Files are of one set if their names have the same words but for those that name a map; a set has a colour and a
    roughness map. `stone_diff_1k.png`, `stone_rough_1k.png`, `moss_diff_1k.png` and `moss_rough_1k.png` are two.
    """
    groups: dict[tuple[str, ...], list[Path]] = {}
    pictures = picture_names(folder)
    for file, said in zip(pictures, words_of_all(pictures)):
        words = tuple(word for word in said if word not in MAP_WORDS)
        groups.setdefault(words, []).append(file)
    whole = {words: files for words, files in groups.items() if _is_whole(candidates(folder, files))}
    if len(whole) < 2:
        return {}
    short = {words: commonprefix([file.stem for file in files]).rstrip("_-. ") for words, files in whole.items()}
    unlike = "" not in short.values() and len(set(short.values())) == len(short)
    return {short[words] if unlike else "_".join(words): files for words, files in whole.items()}


def _is_whole(found: Mapping[str, list[Path]]) -> bool:
    return "colour" in found and bool(set(found) & set(ROUGH))


def candidates(folder: Path, files: Sequence[Path] | None = None) -> dict[str, list[Path]]:
    """Role → the files that are named as it, of these or of all in a folder."""
    files = picture_names(folder) if files is None else files
    words = words_of_all(files)
    shared = _shared_beginning(words) if len(files) > 1 else 0
    found: dict[str, list[Path]] = {}
    for file, said in zip(files, words):
        role = role_of(said, shared)
        if role is not None:
            found.setdefault(role, []).append(file)
    return found


def _shared_beginning(words: list[list[str]]) -> int:
    return len([*takewhile(lambda column: len(set(column)) == 1, zip(*words))])


def role_of(words: list[str], shared: int = 0) -> str | None:
    """The map that words name, the first `shared` of which are the material's."""
    if any(set(pair) in PACKED for pair in zip(words[shared:], words[shared + 1 :])):
        return "packed"
    for first, second in zip(words[shared:], words[shared + 1 :]):
        if ROLE_OF.get(second) == "glossiness" and ROLE_OF.get(first) in WITH_ALPHA and first not in WEAK:
            return f"{ROLE_OF[first]}_glossiness"
    named = [ROLE_OF[w] for i, w in enumerate(words) if w in ROLE_OF and (w not in WEAK or i >= shared)]
    return named[-1] if named else None


def packed_channels(file: Path) -> tuple[int, int]:
    """Return which channels of a packed map are the roughness and the metallic one.

    Green and blue, as glTF has them, red being occlusion; of a name in which occlusion follows, as in
    MetallicRoughnessAO, in the order of its words.
    """
    roles = {"ao": "occlusion", "occlusion": "occlusion"}
    order = [roles.get(word, ROLE_OF.get(word)) for word in words_of(file.stem)]
    order = [role for role in order if role in ("roughness", "metallic", "occlusion")][-3:]
    if len(set(order)) == 3 and order[0] != "occlusion":
        return order.index("roughness"), order.index("metallic")
    return 1, 2


def find_textures(folder: Path, normal: str = "auto", of: Sequence[Path] | None = None) -> Textures:
    """The files of a material's maps, of all in a folder or `of` some.

    `normal` "gl" or "dx" overrules what the normal map's name says.

    A map of its own goes before the same one in a packed picture, a normal map before a height map, and roughness
    before glossiness.

    Raises:
        UserError: if there is no folder, no map, no colour or roughness, or two files for one map.
    """
    if not folder.is_dir():
        raise UserError(f"{folder}: there is no such folder; check the path")
    found = candidates(folder, of)
    if not set(found) & {"colour", *ROUGH}:
        raise UserError(f"{folder}: holds no texture maps; name pictures by one of these words: {LOOKED_FOR}")
    beside = "".join(f", and {file.name} is not read, save it as .png" for file in unread_maps(folder)[:1])
    if "colour" not in found:
        raise UserError(f"{folder}: has no colour map{beside}; add a picture named {', '.join(WORDS['colour'])}")
    if not set(found) & set(ROUGH):
        raise UserError(
            f"{folder}: has no roughness map{beside}; add a grey picture named roughness, or glossiness if it is that"
        )
    found["normal"] = _preferred(found.get("normal", []), normal)
    if not set(found) & {"roughness", "packed"} and "specular" not in found:
        found["specular"] = found.get("reflection", [])  # beside roughness it has no convention
    wanted = {role for role, files in found.items() if files} - {"unused", "reflection"}
    wanted -= {"height"} if found["normal"] else set()
    wanted -= {"packed"} if {"roughness", "metallic"} <= wanted else set()
    wanted -= {"glossiness"} if wanted & {"roughness", "packed"} else set()
    files = {role: _only(folder, role, found[role]) for role in (*WORDS, *ROUGH) if role in wanted}
    down = normal == "dx" or (normal == "auto" and "normal" in files and says(files["normal"], DOWN))
    return Textures(files, down)


def _preferred(files: list[Path], normal: str) -> list[Path]:
    """Of a pair for OpenGL and DirectX the one that was asked for; default: OpenGL."""
    up, down = ([f for f in files if says(f, words)] for words in (UP, DOWN))
    if up and down and len(up) + len(down) == len(files):
        return down if normal == "dx" else up
    return files


def says(file: Path, words: tuple[str, ...]) -> bool:
    """Whether one of these words is in a file's name."""
    return any(word in words for word in words_of(file.stem))


def _only(folder: Path, role: str, files: list[Path]) -> Path:
    if len(files) > 1:
        raise UserError(
            f"{folder}: {files[0].name} and {files[1].name} could both be the {role} map; keep one, or give each set a "
            "folder of its own"
        )
    return files[0]

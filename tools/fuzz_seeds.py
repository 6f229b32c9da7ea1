"""What `tools/fuzz.py` begins with: small good inputs of every kind that the command line reads, and commands that read them.

A tree is a folder in memory, path → content. Everything is made by the libraries that users make their files with, or by
the package itself, and is the same each time.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import os
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import fuzz_mutations as mutations
import numpy as np
from fuzz_mutations import Mutation

ROOT = Path(__file__).resolve().parent.parent
CAMPAIGN = ROOT / "tools" / "campaign"
"""What the campaign found so far, kept with the code: it takes longer than a session."""
TOY = ROOT / "tests" / "training" / "toy.py"
Tree = dict[str, bytes]


@dataclass(frozen=True)
class Family:
    """Inputs of one kind.

    Attributes:
        seeds: makes good trees.
        target: a regular expression for the names of the files that are mutated.
        commands: one of which reads the tree.
    """

    seeds: Callable[[], list[Tree]]
    target: str
    mutation: Mutation
    commands: tuple[str, ...]


def mask(side: int = 24) -> np.ndarray:
    """A bright figure that is not its own mirror image."""
    pixels = np.zeros((side, side), np.uint8)
    pixels[side // 4 : side // 2, side // 4 : -side // 4] = 255
    pixels[side // 2 : -side // 8, side // 3 : side // 2] = 200
    return pixels


def picture(suffix: str, mode: str = "L", side: int = 24, **options: object) -> bytes:
    from PIL import Image

    stream = io.BytesIO()
    image = Image.fromarray(mask(side))
    image = image.point(lambda v: v * 257.0).convert("I;16") if mode == "I;16" else image.convert(mode)
    image.save(stream, {"jpg": "jpeg", "tif": "tiff"}.get(suffix, suffix), **options)
    return stream.getvalue()


MODES = {
    "png": [("L", {}), ("RGBA", {}), ("P", {}), ("1", {}), ("I;16", {}), ("RGB", {}), ("LA", {})],
    "jpg": [("L", {}), ("RGB", {}), ("RGB", {"progressive": True}), ("CMYK", {})],
    "webp": [("RGB", {}), ("RGBA", {"lossless": True})],
    "bmp": [("L", {}), ("RGB", {}), ("1", {}), ("P", {})],
    "tif": [("L", {}), ("RGB", {"compression": "tiff_lzw"}), ("I;16", {}), ("F", {}), ("RGBA", {"compression": "tiff_adobe_deflate"})],
    "gif": [("L", {}), ("P", {})],
}  # fmt: skip
READ_PICTURES = (
    "data inspect in", "data inspect in --for digits --json", "data inspect in --strict --out out.png",
    "data inspect in --for wood --size 16", "data pack in --out out.npz", "data inspect in/top/b.{0}", "data inspect in --mode keep",
)  # fmt: skip


def pictures(suffix: str) -> Family:
    def seeds() -> list[Tree]:
        made = [picture(suffix, mode, **options) for mode, options in MODES[suffix]]
        good = {"in/top/a.png": picture("png"), "in/top/c.png": picture("png", "RGB")}
        return [{f"in/top/b.{suffix}": data, **more} for data in made for more in ({}, good)]

    mutation = mutations.png if suffix == "png" else mutations.bytewise
    return Family(seeds, r"/b\.", mutation, tuple(c.format(suffix) for c in READ_PICTURES))


def idx(count: int = 4) -> bytes:
    return b"\0\0\x08\x03" + struct.pack(">3I", count, 24, 24) + mask().tobytes() * count


def npz(**arrays: object) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # pyright: ignore[reportArgumentType]
    return stream.getvalue()


def volumes(count: int = 3, side: int = 8) -> np.ndarray:
    x = np.zeros((count, side, side, side), np.float32)
    x[:, 2:6, 1:7, 3:5] = 1
    return x


def maps(count: int = 2, side: int = 8) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    normal = np.zeros((count, 3, side, side), np.float32)
    normal[:, 2] = 1
    return {
        "diffuse": rng.random((count, 3, side, side), np.float32),
        "specular": np.full((count, 1, side, side), 0.04, np.float32),
        "roughness": rng.uniform(0.2, 0.6, (count, 1, side, side)).astype(np.float32),
        "normal": normal,
        "fresnel": np.array("albedo"),
    }


def archives() -> list[Tree]:
    masks, rng = np.stack([mask()] * 4), np.random.default_rng(0)
    angle = np.array([0, 0.7, 1.5, 2.0], np.float32)
    kinds = (
        npz(silhouettes=masks, azimuth=angle, elevation=angle / 4),
        npz(images=masks[:, None] / np.float32(255)),
        npz(lines=rng.random((4, 24), np.float32), angle=angle),
        npz(sinograms=rng.random((2, 24, 4), np.float32), angle=angle),
        npz(volume=volumes()),
        npz(masks=masks > 0, names=np.array(["a", "b", "c", "d"])),
    )
    return [{"in/x.npz": data} for data in kinds]


def packed_shapes() -> list[Tree]:
    bits = np.packbits(volumes(3).reshape(3, -1) > 0, axis=1)
    content = {"X_train": bits, "y_train": np.array([0, 1, 1]), "X_test": bits[:1], "y_test": np.array([0])}
    shape = {"shape": np.array([8, 8, 8]), "class_names": np.array(["a", "b"])}
    return [{"in/x.npz": npz(**content, **shape)}, {"in/x.npz": npz(volume=bits, shape=shape["shape"])}]


def binvox() -> list[Tree]:
    runs = b"\0\x40" + b"\1\x80" + b"\0\xff" + b"\0\x41"
    return [{"in/b.binvox": b"#binvox 1\ndim 8 8 8\ntranslate 0 0 0\nscale 1\ndata\n" + runs}]


def mesh(suffix: str) -> Callable[[], list[Tree]]:
    def seeds() -> list[Tree]:
        import trimesh

        shapes = (trimesh.creation.box((1, 2, 3)), trimesh.creation.icosphere(1))
        made: list[bytes | str] = [shape.export(file_type=suffix) for shape in shapes]  # pyright: ignore
        if suffix in ("ply", "stl"):
            made.append(
                shapes[0].export(
                    file_type={"ply": "ply", "stl": "stl_ascii"}[suffix],
                    **({"encoding": "ascii"} if suffix == "ply" else {}),
                )
            )  # pyright: ignore # noqa: E501
        good = {"in/a.binvox": binvox()[0]["in/b.binvox"]}
        data = [part if isinstance(part, bytes) else part.encode() for part in made]
        return [{f"in/b.{suffix}": one} for one in data] + [{f"in/b.{suffix}": data[0], **good}]

    return seeds


def gltf() -> list[Tree]:
    import trimesh

    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.box((1, 2, 3))))
    return [{f"in/{'b.gltf' if name.endswith('.gltf') else name}": data for name, data in files.items()}]


READ_SHAPES = (
    "data inspect in --size 8",
    "data inspect in/b.{0} --size 8",
    "data inspect in --size 8 --strict --out out.png",
)


def shape_files(suffix: str, mutation: Mutation, seeds: Callable[[], list[Tree]]) -> Family:
    return Family(seeds, r"/b\.", mutation, tuple(command.format(suffix) for command in READ_SHAPES))


def probe(suffix: str) -> Callable[[], list[Tree]]:
    """A light probe, beside maps to be lit; or the same picture as a map of a material."""

    def seeds() -> list[Tree]:
        from unproject._pictures import write_picture

        data: list[bytes] = []
        with tempfile.TemporaryDirectory() as folder:
            for channels, depth in ((3, "float"), (3, "half"), (1, "float"))[: 3 if suffix == "exr" else 1]:
                file = Path(folder) / f"x.{suffix}"
                write_picture(file, np.random.default_rng(0).random((8, 16, channels)), depth)  # pyright: ignore
                data.append(file.read_bytes())
        texture = {"in/m/m_roughness.png": picture("png", side=16), "in/a.npz": npz(**maps())}
        return [{f"in/b.{suffix}": one, f"in/m/m_color.{suffix}": one, **texture} for one in data]

    return seeds


def textures() -> list[Tree]:
    grey = picture("png", "L", 16)
    one = {
        "in/m_color.png": picture("png", "RGB", 16), "in/m_roughness.png": grey, "in/m_metalness.png": grey,
        "in/m_height.png": grey, "in/m_ao.png": grey,
    }  # fmt: skip
    other = {"in/k/k_albedo.jpg": picture("jpg", "RGB", 16), "in/k/k_arm.png": picture("png", "RGB", 16)}
    return [one, {**{name.replace("in/", "in/m/"): data for name, data in one.items()}, **other}]


def views() -> list[Tree]:
    table = "file,azimuth,elevation\na.png,0,10\nb.png,90,0\nc.png,-30.5,1e1\n"
    files = {f"in/{name}.png": picture("png") for name in "abc"}
    return [
        {"in/views.csv": table.encode(), **files},
        {"in/views.csv": table.replace(",elevation", "").replace(",10", "").encode(), **files},
    ]


# What the package wrote itself


def run_words(words: str, folder: str, inputs: Tree | None = None) -> Tree:
    """What a folder holds after a command was run in it."""
    write(inputs or {}, Path(folder))
    command = [sys.executable, "-m", "unproject", *words.split()]
    subprocess.run(
        command, cwd=folder, check=True, stdout=subprocess.DEVNULL, env={**os.environ, "OMP_NUM_THREADS": "1"}
    )
    return read(Path(folder))


def write(tree: Tree, folder: Path) -> None:
    for name, data in tree.items():
        with contextlib.suppress(FileExistsError):
            (folder / name).parent.mkdir(parents=True)
        (folder / name).write_bytes(data)


def read(folder: Path) -> Tree:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


TRAIN = f"train {TOY}:toy --steps 2 --checkpoint-every 1 --quiet --threads 1 --out in"


@cache
def run() -> list[Tree]:
    """Runs of the toy recipe: views known, and predicted. One checkpoint each: they are the largest part of an input."""
    found = []
    for flags in ("--views known", "--views predicted"):
        with tempfile.TemporaryDirectory() as folder:
            found.append(run_words(f"{TRAIN} {flags}", folder))
    return [{name: data for name, data in tree.items() if "step-000000001" not in name} for tree in found]


def pack() -> list[Tree]:
    files = {f"masks/{name}.png": picture("png") for name in "abc"} | {
        "masks/views.csv": b"file,azimuth\na.png,0\nb.png,9\nc.png,5\n"
    }
    found = []
    for recipe in ("shapes", "digits"):
        with tempfile.TemporaryDirectory() as folder:
            found.append(
                {"in/x.npz": run_words(f"data pack masks --for {recipe} --out p.npz --size 24", folder, files)["p.npz"]}
            )
    return found


def results() -> list[Tree]:
    """Results of a figure, as docs/results holds them."""
    folder = ROOT / "docs" / "results" / "reproduction" / "cpu" / "results"
    names = [name for name in os.listdir(folder) if name.endswith(".json") and name.split("-")[0] in ("birds", "truth")]
    return [
        {
            f"in/cpu/results/{n}": (folder / n).read_bytes()
            for n in sorted(names)
            if n.startswith(("birds", "truth-birds"))
        }
    ]


FIT = "fit in in/x.png --out in/fits --candidates 4 --starts 1 --steps 1 --tune 0 --no-novelty --trust --threads 1"


@cache
def fits() -> list[Tree]:
    with tempfile.TemporaryDirectory() as folder:
        return [run_words(FIT, folder, {**run()[0], "in/x.png": picture("png")})]


READ_RUN = (
    "sample in --n 2 --out out.npz --trust", "resume in --steps 3 --trust --quiet --threads 1", "evaluate in --n 4 --json --trust",
    "export in --n 2 --to npz --out out.npz --trust", "report in --out out.html --trust", "sample in --n 2 --out out.npz",
    f"train {TOY}:toy --steps 1 --quiet --views known --threads 1 --from in --out out",
)  # fmt: skip
WITHOUT_TRUST = (
    "sample in --n 2 --out out.npz",
    "resume in --steps 3 --quiet",
    "evaluate in --n 4",
    "report in --out out.html",
)

FAMILIES: dict[str, Family] = {
    **{suffix: pictures(suffix) for suffix in MODES},
    "idx": Family(lambda: [{"in/x.idx": idx()}], "x.idx", mutations.bytewise, ("data inspect in/x.idx --for digits", "data inspect in/x.idx", "data inspect in/x.idx --mode crop --out out.png")),
    "idx.gz": Family(lambda: [{"in/x.gz": gzip.compress(idx(), 1)}], "x.gz", mutations.gzipped(mutations.bytewise), ("data inspect in/x.gz --for digits", "data inspect in/x.gz")),
    "npy": Family(lambda: [{"in/x.npy": mutations.saved(a)} for a in (np.stack([mask()] * 3), volumes(), volumes()[:, :1])], "x.npy", mutations.array, ("data inspect in/x.npy", "data inspect in/x.npy --for digits", "data inspect in/x.npy --size 16 --mode crop", "data inspect in/x.npy --for wood")),
    "npz": Family(archives, "x.npz", mutations.zipped, ("data inspect in/x.npz", "data inspect in/x.npz --for digits --json", "data inspect in/x.npz --size 16 --mode crop", "export in/x.npz --to png --out out.png", "export in/x.npz --to npz --out out.npz", "data inspect in/x.npz --out out.png")),
    "npz of volumes": Family(lambda: [{"in/x.npz": npz(volume=volumes())}], "x.npz", mutations.zipped, tuple(f"export in/x.npz --to {to} --out out" for to in ("glb", "obj", "ply", "vox")) + ("export in/x.npz --to gif --out out.gif", "data inspect in/x.npz --size 8")),
    "npz of maps": Family(lambda: [{"in/x.npz": npz(**maps())}], "x.npz", mutations.zipped, ("export in/x.npz --to maps --out out", "export in/x.npz --to gltf --out out", "render in/x.npz --samples 2 --out out.png", "render in/x.npz --light directional:30,0 --out out.npy", "data inspect in/x.npz --for wood --size 8")),
    "packed shapes": Family(packed_shapes, "x.npz", mutations.zipped, ("data inspect in/x.npz --size 8", "data inspect in/x.npz:a --size 8", "data inspect in/x.npz:b/test")),
    "pack": Family(pack, "x.npz", mutations.zipped, ("data inspect in/x.npz", "data inspect in/x.npz --for digits", "data inspect in/x.npz --size 16 --out out.png")),
    "binvox": shape_files("binvox", lambda data, rng: (mutations.textual if rng.random() < 0.5 else mutations.bytewise)(data, rng), binvox),
    "obj": shape_files("obj", mutations.textual, mesh("obj")),
    "ply": shape_files("ply", mutations.textual, mesh("ply")),
    "stl": shape_files("stl", mutations.textual, mesh("stl")),
    "off": shape_files("off", mutations.textual, mesh("off")),
    "glb": shape_files("glb", mutations.glb, mesh("glb")),
    "gltf": shape_files("gltf", mutations.structured, gltf),
    "hdr": Family(probe("hdr"), ".hdr", mutations.textual, ("render in/a.npz --light env:in/b.hdr --samples 2 --out out.png", "data inspect in/m --for wood --size 8")),
    "exr": Family(probe("exr"), ".exr", mutations.bytewise, ("render in/a.npz --light env:in/b.exr --samples 2 --out out.png", "data inspect in/m --for wood --size 8")),
    "textures": Family(textures, ".png", mutations.png, ("data inspect in --for wood --size 8", "export in --to maps --out out", "render in --samples 2 --out out.png")),
    "views.csv": Family(views, "views.csv", mutations.textual, ("data inspect in", "data pack in --out out.npz", "data inspect in --for digits")),
    "recipe.json": Family(run, "recipe.json", mutations.structured, (*READ_RUN, *WITHOUT_TRUST)),
    "stats.jsonl": Family(run, "stats.jsonl", mutations.json_lines, ("report in --out out.html --trust", "resume in --steps 3 --trust --quiet --threads 1", "evaluate in --n 4 --trust")),
    "environment, verdict": Family(run, r"(environment|verdict)\.json", mutations.structured, ("report in --out out.html --trust", "resume in --steps 3 --trust --quiet --threads 1")),
    "checkpoint": Family(run, ".safetensors", mutations.weights, READ_RUN),
    "results": Family(results, ".json", mutations.structured, ("reproduce fig3 --report --out in --runs out",)),
    "fits": Family(fits, r"in/fits/.*(json|npz)", mutations.by_content, (FIT,)),
}  # fmt: skip


def clear(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)

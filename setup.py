"""Compiled kernels in wheels; everything else is in pyproject.toml.

Without a compiler the wheel has none, and suits any machine: kernels are then compiled on first use, or torch is used.
The kernels are plain C functions, so that one wheel serves each version of Python.
"""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

OPS = Path("src/unproject/ops")
BILL = Path("sbom.cdx.json")
BUILDS = runpy.run_path(str(OPS / "_builds.py"))


class BuildWithKernels(build_py):
    """Adds ops/kernels/ to the package, unless it stays where it is (pip install -e)."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            BUILDS["compile_all"](OPS, Path(self.build_lib) / "unproject" / "ops" / "kernels")


class WheelOfAnyPython(bdist_wheel):
    """A wheel for each version of Python."""

    def get_tag(self) -> tuple[str, str, str]:
        return "py3", "none", super().get_tag()[2]

    def egg2dist(self, egginfo_path: str, distinfo_path: str) -> None:
        """Add the bill of materials that `make dist` wrote, where PEP 770 says."""
        super().egg2dist(egginfo_path, distinfo_path)
        if BILL.exists():
            place = Path(distinfo_path) / "sboms"
            place.mkdir()
            shutil.copy(BILL, place / BILL.name)


class WithKernels(Distribution):
    """A package of this kind of machine if there is a compiler, else of any."""

    def has_ext_modules(self) -> bool:
        return BUILDS["can_compile"]()


setup(distclass=WithKernels, cmdclass={"build_py": BuildWithKernels, "bdist_wheel": WheelOfAnyPython})

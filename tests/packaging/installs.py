"""Environments with exactly what an installation brings, made in a moment and without a network.

The requirements of the built wheel are followed, as pip follows them, through the metadata of the
packages that are installed here. A new virtual environment gets links to the packages found, and
nothing else: an import that no requirement promises fails in it, in subprocesses too. Real
installations would test the same imports, but take minutes and gigabytes each.
"""

import csv
import os
import subprocess
import sysconfig
import venv
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution, distributions
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

SITE = Path(sysconfig.get_path("purelib"))


@dataclass(frozen=True)
class Installation:
    """A virtual environment in a folder."""

    folder: Path

    @property
    def python(self) -> Path:
        return self.folder / "bin" / "python"

    @property
    def site(self) -> Path:
        """Its site-packages."""
        return next((self.folder / "lib").glob("python*/site-packages"))

    def run(self, *arguments, expect: int = 0, **options) -> str:
        """What its Python prints, errors included; fails unless the exit status is as expected."""
        environment = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("PYTHON", "JUPYTER", "COV")) and name != "VIRTUAL_ENV"
        }
        done = subprocess.run(
            [self.python, *arguments],
            env=environment | {"OMP_NUM_THREADS": "1", "MPLBACKEND": "agg"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            **options,
        )
        assert done.returncode == expect, done.stdout
        return done.stdout


def install(folder: Path, wheel: Path, *requirements: str) -> Installation:
    """A virtual environment with what `pip install` of these requirements would bring.

    Arguments:
        wheel: the folder that the project's wheel was unpacked in.
    """
    venv.create(folder, symlinks=True, with_pip=False)
    installation = Installation(folder)
    for name, found in resolve(wheel, requirements).items():
        source = wheel if name == "uavdh-lite" else SITE
        for path in _links(found):
            target = Path(os.path.normpath(installation.site / path))
            target.parent.mkdir(parents=True, exist_ok=True)
            target.symlink_to(os.path.normpath(source / path))
    return installation


def _links(found: Distribution) -> set[str]:
    """The paths, relative to site-packages, that a distribution needs: folders if all their own."""
    paths = {path: path.partition("/")[0] for path in _files(found)}
    return {
        path if top == ".." or len(_owners()[top]) > 1 else top
        for path, top in paths.items()
        if top != "__pycache__" and not path.startswith("../../../bin/")
    }


def _files(found: Distribution) -> list[str]:
    return [path for path, *_ in csv.reader((found.read_text("RECORD") or "").splitlines())]


@cache
def _owners() -> dict[str, set[int]]:
    """The distributions, as numbers, that have files in each folder of site-packages."""
    owners = defaultdict(set)
    for number, each in enumerate(distributions(path=[str(SITE)])):
        for path in _files(each):
            owners[path.partition("/")[0]].add(number)
    return owners


def resolve(wheel: Path, requirements: Iterable[str]) -> dict[str, Distribution]:
    """The distributions that these requirements bring, by name.

    Raises `AssertionError` if the version that is installed here is not allowed.
    """
    (ours,) = distributions(path=[str(wheel)])
    found, seen = {}, set()
    waiting = [(Requirement(text), "the command") for text in requirements]
    while waiting:
        wanted, by = waiting.pop()
        name = canonicalize_name(wanted.name)
        if (name, *sorted(wanted.extras)) in seen:
            continue
        seen.add((name, *sorted(wanted.extras)))
        try:
            found[name] = ours if name == "uavdh-lite" else distribution(name)
        except PackageNotFoundError:
            raise AssertionError(f"{by} needs {wanted}, which is not in environment.txt") from None
        version = found[name].version
        assert wanted.specifier.contains(version, prereleases=True), f"{by}: {wanted}, is {version}"
        for text in found[name].requires or ():
            needed = Requirement(text)
            asked = ["", *wanted.extras]
            if not needed.marker or any(needed.marker.evaluate({"extra": e}) for e in asked):
                waiting.append((needed, name))
    return found

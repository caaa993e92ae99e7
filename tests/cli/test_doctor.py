"""`doctor`: it says what is missing, and which command installs it."""

import tomllib
import webbrowser
from importlib import metadata
from pathlib import Path

from uavdh_lite.cli import doctor
from uavdh_lite.cli.main import main


def test_what_is_missing_is_named_with_its_command(monkeypatch, capsys):
    real = metadata.version

    def version(name):
        if name in ("ipykernel", "jupyterlab"):
            raise metadata.PackageNotFoundError(name)
        return real(name)

    needs = ["numpy>=1.26", "ipykernel>=6.29; extra == 'notebooks'", "gymnasium; extra == 'gym'"]
    needs.append("jupyterlab>=4; extra == 'notebooks'")
    monkeypatch.setattr(metadata, "version", version)
    monkeypatch.setattr(metadata, "requires", lambda name: needs)
    monkeypatch.setattr(webbrowser, "get", lambda: object())
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert "missing ipykernel, jupyterlab: pip install 'uavdh-lite[notebooks]'" in said
    assert "Gymnasium: ok" in said and "classroom" not in said
    assert "100% landed: ok" in said or "9" in said.partition("% landed")[0][-2:]


def test_without_a_browser_or_an_installation_it_says_so(monkeypatch, capsys):
    def none(*arguments):
        raise webbrowser.Error

    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(webbrowser, "get", none)
    monkeypatch.setattr(metadata, "requires", missing)
    monkeypatch.setattr(doctor, "_flown", lambda: "")
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert "not installed: pip install ." in said and "none is found: open the address" in said


def test_the_extras_are_those_of_the_package():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert set(doctor.EXTRAS) <= set(project["optional-dependencies"])

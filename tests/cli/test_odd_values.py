"""Whatever is typed for an option: one line says what is wrong, or the work begins."""

import pytest

from uavdh_lite.cli import flying, training
from uavdh_lite.cli.main import COMMANDS, _application, main

ODD = ["", " ", "-1", "0", "1.5", "nan", "inf", "-inf", "1e400", "1e-300", "9" * 19, "9" * 5000]
ODD += [
    "x",
    "none",
    "true",
    "[]",
    "\ud800",
    "a\0b",
    "\udcff",
    "γ" * 300,
    "/",
    ".",
    "-",
    "random:1:",
]
ODD += ["random:" + "9" * 30 + ":0", "random:1:" + "9" * 5000, "a/b", "--", "leak=[[", "hidden=3"]
FIRST = {  # what the command needs besides
    "export": ["--checkpoint", "manhattan"],
    "train": ["--scenario", "village", "--recipe", "small"],
    "study": ["--scenario", "village", "--recipe", "small"],
}


class Begun(Exception):
    """The work would begin now."""


def options(command):
    application = _application([command])
    found = application[command].assemble_argument_collection()
    return [each.name for each in found if each.parse and each.name.startswith("--")]


OPTIONS = [
    (command, name)
    for command in COMMANDS
    if command not in ("challenge", "city", "app")
    for name in options(command)
]


@pytest.mark.parametrize("every", [12, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize(("command", "name"), OPTIONS)
def test_an_odd_value_gives_one_line_or_the_work_begins(
    command, name, every, monkeypatch, tmp_path, capsys
):
    """Each option with a twelfth of the values, another for the next; with all in long tests."""

    def begin(*arguments, **named):
        raise Begun

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(training.torch, "set_num_threads", lambda number: None)
    for module, works in (
        (flying.evaluation, ["evaluate"]),
        (flying.missions.Mission, ["fly"]),
        (flying.comparison, ["compare"]),
        (flying, ["export_onnx"]),
        (training.runs, ["train"]),
        (training.studies, ["run_study"]),
    ):
        for work in works:
            monkeypatch.setattr(module, work, begin)
    refused = 0
    for value in ODD[OPTIONS.index((command, name)) % every :: every]:
        arguments = [command, *FIRST.get(command, []), name, value]
        try:
            assert main(arguments) in (1, 2), ascii(arguments)
        except Begun:
            continue
        except Exception as error:
            pytest.fail(ascii(f"{arguments}: {type(error)} {error}")[-400:])
        refused += 1
        error = capsys.readouterr().err
        assert error.startswith("uavdh_lite: error: ") and error.count("\n") == 1, ascii(error)
    assert refused > 3 or every > 1
    assert not [path for path in tmp_path.iterdir() if name != "--save-mission"]

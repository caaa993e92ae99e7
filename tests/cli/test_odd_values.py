"""Whatever is typed for an option: one line says what is wrong, or the work begins."""

import pytest

from uavdh_lite.bridges import sionna
from uavdh_lite.cli import challenge, city, flying, training
from uavdh_lite.cli.main import COMMANDS, _application, main
from uavdh_lite.labs import page

ODD = ["", " ", "-1", "0", "1.5", "nan", "inf", "-inf", "1e400", "1e-300", "9" * 19, "9" * 5000]
ODD += ["x", "none", "true", "[]", "\ud800", "a\0b", "\udcff", "γ" * 300, "/", ".", "-"]
ODD += ["random:1:"]
ODD += ["random:" + "9" * 30 + ":0", "random:1:" + "9" * 5000, "a/b", "--", "leak=[[", "hidden=3"]
FIRST = {  # what the command needs besides, places first
    "export": ["--checkpoint", "manhattan"],
    "train": ["--scenario", "village", "--recipe", "small"],
    "study": ["--scenario", "village", "--recipe", "small"],
    "challenge new": ["secret.json"],
    "challenge score": ["greedy"],
    "challenge show": ["board.json"],
    "city": ["streets.geojson", "--centre", "50,8"],
    "classroom collect": ["handed_in.zip", "01_city"],
    "classroom check": ["01_city"],
    "classroom return": ["01_city", "feedback.zip"],
}


class Begun(Exception):
    """The work would begin now."""


def options(application, *words):
    """(command, option), or (command, which place) where a value has no name."""
    if application.default_command:
        command, places = " ".join(words), 0
        for each in application.assemble_argument_collection():
            if each.parse and each.name.startswith("--"):
                yield command, each.name
            elif each.parse and not each.name.startswith("*"):
                yield command, places
                places += 1
    for word in application:
        if not word.startswith("-"):
            yield from options(application[word], *words, word)


LONGEST = pytest.mark.long, pytest.mark.longest
OPTIONS = [one for name in COMMANDS for one in options(_application([name])[name], name)]


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=LONGEST)])
@pytest.mark.parametrize(("command", "name"), OPTIONS)
def test_an_odd_value_gives_one_line_or_the_work_begins(
    command, name, every, monkeypatch, tmp_path, capsys
):
    """Each option with a quarter of the values, another for the next; with all once a week."""

    def begin(*arguments, **named):
        raise Begun

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(training.torch, "set_num_threads", lambda number: None)
    monkeypatch.setattr(page, "write_page", begin)
    for module, works in (
        (challenge, ["flown_score"]),
        (challenge.Challenge, ["save"]),
        (city, ["city_of_footprints"]),
        (sionna, ["Tracer"]),
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
        arguments = [*command.split(), *FIRST.get(command, [])]
        if isinstance(name, int):
            place = len(command.split()) + name
            arguments[place : place + 1] = [value]
        else:
            arguments += [name, value]
        try:
            assert main(arguments) in (1, 2), ascii(arguments)
        except Begun:
            continue
        except Exception as error:
            pytest.fail(ascii(f"{arguments}: {type(error)} {error}")[-400:])
        refused += 1
        error = capsys.readouterr().err
        assert error.startswith("uavdh_lite: error: ") and error.count("\n") == 1, ascii(error)
    assert refused > 2 or every > 1
    made = list(tmp_path.rglob("*"))
    if name == "--leaderboard":  # its lock is made before the work, and the folder of that
        made = [path for path in made if path.suffix != ".lock" and not path.is_dir()]
    assert not made or name == "--save-mission"

import io
import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from matplotlib import rc_context
from PIL import Image

from uavdh_lite import registry
from uavdh_lite.channel import Channel
from uavdh_lite.checkpoint import load_agent, save_agent, shipped_agents
from uavdh_lite.city import City
from uavdh_lite.cli import training
from uavdh_lite.cli.main import COMMANDS, main
from uavdh_lite.cli.options import output, presets
from uavdh_lite.evaluation import bootstrap_interval, mean_interval
from uavdh_lite.experiments.report import interval_text
from uavdh_lite.paper import RESULTS
from uavdh_lite.recipe import find_recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import data_folder, read_table

SHORT = ["--steps", "320", "--replay-prefill", "160", "--validation-episodes", "5"]
SHORT += ["--threads", "1"]


def failing(capsys, *arguments):
    """The one-line error of a command that must fail with status 2."""
    status = main(list(arguments))
    error = capsys.readouterr().err
    assert status == 2
    assert error.endswith("\n") and error.count("\n") == 1
    assert error.startswith("uavdh_lite: error: ")
    return error


def help_of(capsys, *arguments):
    """What `--help` prints, on one line and without boxes."""
    assert main([*arguments, "--help"]) == 0
    return " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.mark.long
def test_demo_prints_the_table_beside_the_papers_and_draws(tmp_path, capsys):
    assert main(["demo", "--episodes", "3", "--out", str(tmp_path / "d.png")]) == 0
    output = capsys.readouterr().out
    assert "94.6 %" in output and all(name in output for name in RESULTS)
    with Image.open(tmp_path / "d.png") as image:
        assert min(image.size) > 1000 and np.asarray(image).std() > 20


@pytest.mark.parametrize("name", RESULTS)
def test_the_papers_agents_land_and_collect_and_evaluate_writes_json(name, tmp_path, capsys):
    path = tmp_path / "r.json"
    assert main(["evaluate", "--checkpoint", name, "--episodes", "300", "--json", str(path)]) == 0
    values = json.loads(path.read_text())
    assert values["landed"]["mean"] > 0.98 and values["collected_and_landed"]["mean"] > 0.85
    for one in values.values():
        assert one["low"] - 1e-9 <= one["mean"] <= one["high"] + 1e-9
    assert f"{100 * values['collected']['mean']:.1f}" in capsys.readouterr().out


def test_compare_writes_every_episode_and_its_intervals_are_those_of_whole_cities(tmp_path, capsys):
    """`evaluate` has the same missions."""
    out = tmp_path / "table.csv.gz"
    options = ["--checkpoint", "any_city", "--city", "random:3:5:8", "--episodes", "30"]
    command = ["compare", *options, "--others", "any_city", "--out", str(out)]
    assert main(command) == 0
    names = ["agent", "any_city", "random", "greedy", "genie", "genie_data"]
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[2:8]] == names
    table = read_table(out)
    policy, count = np.unique(table["policy"], return_counts=True)
    assert policy.tolist() == sorted(names) and (count == 30).all()
    about = json.loads((tmp_path / "table.json").read_text())
    assert about["command"] == shlex.join(["python", "-m", "uavdh_lite", *command])
    assert about["seed"] == 0 and about["agent"]["steps"] > 0
    of_agent = table["policy"] == "agent"
    values, cities = table["return"][of_agent], table["city"][of_agent]
    whole = interval_text("return", mean_interval(values, cities))
    assert whole in lines[2] and whole != interval_text("return", bootstrap_interval(values))
    assert main(["evaluate", *options]) == 0
    assert whole in capsys.readouterr().out


def test_what_the_scenario_or_the_channel_have_otherwise_is_said(tmp_path, capsys):
    """Of an agent that learned another task under the name of a preset."""
    village, out = load_agent("any_city").over(City.load("village")), tmp_path / "a.csv"
    own = replace(find_scenario("village"), data=(0.1, 0.5), devices=(1, 1))
    loud = Channel(cell_edge_snr_db=15.0)
    path, mission = str(tmp_path / "loud.safetensors"), str(tmp_path / "m.json")
    learned = replace(village, scenario=replace(own, channel=loud), trained_in=village.cities)
    save_agent(path, learned)
    said = "cell_edge_snr_db 15, not -15"
    assert (
        main(["fly", "--city", "village", "--save-mission", mission, "--out", f"{path}.png"]) == 0
    )
    assert "SNR" not in capsys.readouterr().out.replace("snr", "SNR")
    assert main(["fly", "--checkpoint", path, "--mission", mission, "--out", f"{path}.png"]) == 0
    assert f" over village, with {said}: " in capsys.readouterr().out
    heading = f"village, but devices 1 to 1, not 1 to 2; data 0.1 to 0.5, not 5 to 15; {said}: 2 "
    for command in (["evaluate"], ["compare", "--out", str(out)]):
        assert main([*command, "--checkpoint", path, "--episodes", "2"]) == 0
        assert capsys.readouterr().out.startswith(heading)
    about = json.loads(out.with_suffix(".json").read_text())
    assert about["scenario"]["data"] == [0.1, 0.5] and about["cities"] == village.city.fingerprint
    assert about["scenario"]["channel"]["cell_edge_snr_db"] == 15
    assert "row of this name" in failing(capsys, "compare", "--others", "agent")
    of_loud = ["compare", "--checkpoint", path, "--episodes", "2", "--others", "any_city"]
    assert main([*of_loud, "--out", str(out)]) == 0
    (tmp_path / "there.csv").mkdir()  # what cannot be written is printed all the same
    assert main([*of_loud, "--out", str(tmp_path / "there.csv")]) == 1
    assert capsys.readouterr().out.count("genie_data") == 2
    assert "is not a comparison's" in failing(capsys, *of_loud, "--out", f"{mission[:-5]}.csv.gz")


def test_a_mission_is_saved_changed_and_flown_again(tmp_path, capsys):
    path, picture, page = (tmp_path / name for name in ("m.json", "f.png", "f.HTML"))
    begun = ["fly", "--city", "village", "--seed", "4", "--save-mission", str(path)]
    assert main([*begun, "--out", str(picture)]) == 0
    first = capsys.readouterr().out
    assert picture.stat().st_size > 10_000
    assert main(["fly", "--mission", str(path), "--out", str(page)]) == 0
    assert capsys.readouterr().out.replace("HTML", "png") == first
    data = re.search(r"data (\S+)/(\S+)\. ", first).groups()
    assert f"{data[0]} of {data[1]} units of data" in page.read_text(encoding="utf-8")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"flying_time": 20}))
    assert main(["fly", "--mission", str(path), "--out", str(picture)]) == 0
    assert "/20" in capsys.readouterr().out


def test_train_takes_a_city_and_ranges_of_ones_own(corridor, tmp_path):
    corridor.save(tmp_path / "mine.png")
    arguments = ["train", *SHORT, "--city", str(tmp_path / "mine.png"), "--devices", "1", "1"]
    arguments += ["--data", "1", "4", "--flying-time", "8", "14", "--flying-time", "9", "14"]
    arguments += ["--kernel-size", "3", "--huber-delta", "none"]
    arguments += ["--no-layer-norm", "--hidden", "16", "--strides", "1", "2"]
    assert main([*arguments, "--out", str(tmp_path / "run")]) == 0
    agent = load_agent(tmp_path / "run" / "best.safetensors")
    assert agent.city.fingerprint == corridor.fingerprint
    assert agent.scenario.devices == (1, 1) and agent.scenario.data == (1.0, 4.0)
    assert agent.scenario.flying_time == (9, 14)  # options given twice hold as given last
    assert agent.recipe.strides == (1, 2) and agent.recipe.hidden == (16,)
    assert agent.recipe.huber_delta is None and agent.recipe.layer_norm is False
    assert agent.training["threads"] == 1


def test_without_a_checkpoint_the_agent_flies_that_knows_the_city_best(capsys):
    for city, scenario in (("random:1:3:12", "any_city"), ("open_field", "open_field")):
        assert main(["evaluate", "--episodes", "1", "--city", city]) == 0
        header, _, row = capsys.readouterr().out.splitlines()
        assert f"{scenario}: 1 random missions over " in header and ", seed 0" in header
        assert row.split()[0] == scenario and "(" not in row  # a single value has no interval


@pytest.mark.parametrize(("command", "name"), [("train", "lite"), ("study", "told")])
def test_help_explains_every_field_with_the_value_of_the_recipe_that_is_named(
    command, name, capsys
):
    recipe = find_recipe(name)
    output = help_of(capsys, command, "--recipe", name)
    for field in fields(recipe)[1:]:  # the first is the name
        value = getattr(recipe, field.name)
        typed = " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
        help, default = map(re.escape, (field.metadata["help"], typed.replace("None", "none")))
        assert f"--{field.name.replace('_', '-')} " in output
        assert re.search(rf"{help}( \[choices: .*?\])? \[default: {default}\]", output), field.name
    for field in fields(Channel):
        assert field.metadata["help"] in output
    assert "--cell-edge-snr FLOAT" in output


def test_help_names_what_there_is_and_shows_the_scenario_that_is_named(capsys):
    output = help_of(capsys, "train", "--kernels", "3", "--scenario=harbour", "--resume")
    assert "least and most number of devices [default: 3 10]" in output
    known = [*registry.names("recipe"), *registry.names("scenario")]
    assert all(name in output for name in known) and "--failsafe" not in output


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("train --scenario mars", "mars"),
        ("train --recipe secret --help", "secret"),
        ("fly --mission m.json --city village", "leave out --city and --seed"),
        ("fly --checkpoint any_city", "any_city over 3000 cities: .*--city"),
        ("compare --out r.json", "must end in .csv"),
        ("fly --city random:1:0:33", "33 × 33 cells: train one .*, or name one of larger"),
        ("study --variants name=../x", "write FIELD=VALUE"),
        ("study --variants as_it_is kernel_size=60", "variant 'kernel_size=60': a map of 31×31"),
        ("train --discoun 1", "--discount"),
        ("train --kernels 1.5", "--kernels"),
        ("train --out=", "--out is empty"),
        ("evaluate --seed -1", "--seed"),
        ("fly --city a\x1b[2J.png", r"a\\x1b\[2J.png: cannot be read"),
        ("train --device cuda", "cuda"),
        ("evaluate --checkpoint none.safetensors", "none.safetensors"),
        ("dance", "dance"),
        ("", "--help"),
        ("app --no-browser --out city.png", "city.png: must end in .html"),
    ],
)
def test_bad_values_give_one_line_and_status_2(capsys, tmp_path, monkeypatch, arguments, named):
    monkeypatch.chdir(tmp_path)
    assert re.search(named, failing(capsys, *arguments.split()))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("train --out study", "study: holds a study"),
        ("study --recipe small --out run", "run: holds a single run"),
        ("classroom return 01 handed_in.zip", "handed_in.zip exists"),
    ],
)
def test_what_is_there_is_not_overwritten_unasked(capsys, tmp_path, monkeypatch, arguments, named):
    monkeypatch.chdir(tmp_path)
    there = "handed_in.zip study/training.csv.gz run/training.safetensors"
    for name in there.split():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    (tmp_path / "feedback/a/01").mkdir(parents=True)
    (tmp_path / "feedback/a/01/01.html").write_text("mine")
    assert named in failing(capsys, *arguments.split())
    assert {p.read_text() for p in tmp_path.rglob("*") if p.is_file()} == {"mine"}


def test_without_a_name_a_free_one_is_taken(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, there in (("a.csv.gz", "a.json"), ("a-2.csv.gz", "a-2.csv.gz"), ("a-3.csv.gz", "")):
        with pytest.raises(OSError, match="full"), output(None, "a", ".csv.gz", ".json") as path:
            assert path == Path(name) and path.exists()  # at once, so that no other takes it
            raise OSError("full")
        assert not path.exists()
        Path(there).touch()  # also what is written beside it
    with output(Path("a.csv.gz"), "b", ".csv.gz") as path:
        assert path == Path("a.csv.gz")  # is replaced
    Path("city-outlines.svg").touch()
    campus = str(data_folder() / "places" / "campus.geojson")
    assert main(["city", campus, "--centre", "50", "8", "--cells", "12"]) == 0
    assert not Path("city-outlines.svg").read_bytes() and Path("city-2-outlines.svg").exists()
    for name in ("labs.html", "labs-2.html"):
        assert main(["app", "--no-browser"]) == 0 and Path(name).exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("fly --city village --out file/c.png", "file: File exists"),
        ("fly --mission nowhere.json", "nowhere.json: No such file"),
    ],
)
def test_files_give_one_line_and_status_1(capsys, tmp_path, monkeypatch, arguments, named):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    assert main(arguments.split()) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"uavdh_lite: error: {named}") and error.count("\n") == 1


def test_city_writes_what_it_made_of_footprints(tmp_path, capsys):
    out, campus = tmp_path / "campus.png", data_folder() / "places" / "campus.geojson"
    assert (
        main(["city", str(campus), "--centre", "50", "8", "--cells", "12", "--out", str(out)]) == 0
    )
    printed, made = capsys.readouterr().out, City.load(out)
    assert made.text in printed and made.size == 12 and "  7  used as buildings" in printed
    assert (tmp_path / "campus-outlines.svg").read_text().startswith("<?xml")
    cut = ["--altitude", "40", "--out", str(out)]  # only the building of unknown height is higher
    for assumed, tall in (([], True), (["--assumed", "39"], False)):
        assert main(["city", str(campus), "--centre", "50", "8", *cut, *assumed]) == 0
        assert City.load(out).no_fly.any() == tall


def test_too_little_memory_gives_one_line_and_status_1(capsys, monkeypatch):
    for allocate in (np.ones, torch.ones):
        monkeypatch.setattr("uavdh_lite.city.City.load", lambda name, make=allocate: make(2**50))
        assert main(["fly", "--city", "village"]) == 1
        error = capsys.readouterr().err
        assert "memory" in error and error.count("\n") == 1


def test_a_style_that_needs_latex_gives_one_line_where_there_is_none(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", "")
    out = ["fly", "--city", "village", "--out", str(tmp_path / "f.png")]
    with rc_context({"text.usetex": True}):
        assert main(out) == 1
    error = capsys.readouterr().err
    assert "latex could not be found" in error and error.count("\n") == 1


def test_nothing_is_said_when_nobody_reads_what_is_printed(capsys, monkeypatch):
    read, write = os.pipe()
    os.close(read)
    with open(write, "w") as closed:
        monkeypatch.setattr(sys, "stdout", closed)
        assert main(["evaluate", "--city", "village", "--episodes", "1"]) == 141
        monkeypatch.undo()
    assert not capsys.readouterr().err


def test_the_list_of_commands_needs_no_torch_and_is_plain_text_of_the_terminals_width():
    call = """import sys
from uavdh_lite.cli.main import main
main(["--help"])
print("imported:", *sys.modules)"""
    call, env = [sys.executable, "-c", call], {**os.environ, "COLUMNS": "100"}
    output = subprocess.run(call, capture_output=True, env=env, text=True, check=True).stdout
    printed, imported = output.split("imported:")
    assert printed.startswith("Usage: uavdh_lite") and "\x1b" not in printed
    assert all(f"│ {name} " in printed for name in COMMANDS)
    assert max(map(len, printed.splitlines())) == 100
    assert not set(imported.split()) & {"torch", "matplotlib", "numpy", "joblib"}


@pytest.mark.filterwarnings("default")
def test_a_warning_is_one_line(tmp_path, capsys):
    walled = City.from_text(
        "walled", "L . N . . \n N N N . . \n . . . . . \n . . . . . \n . . . . L"
    )
    walled.save(tmp_path / "walled.png")
    evaluated = ["evaluate", "--checkpoint", "any_city", "--episodes", "2"]
    assert main([*evaluated, "--city", str(tmp_path / "walled.png")]) == 0
    error = capsys.readouterr().err
    assert error.startswith("uavdh_lite: warning: ") and error.count("\n") == 1
    assert "walled.png: from the landing zone at row 0, column 0" in error


def test_a_training_stopped_before_a_validation_says_that_it_has_no_best_agent(tmp_path, capsys):
    begun = ["train", *SHORT, "--scenario", "village", "--recipe", "small"]
    begun += ["--replay-prefill", "64", "--out", str(tmp_path)]
    assert main([*begun, "--stop-after", "160"]) == 0
    best = tmp_path / "best.safetensors"
    printed = capsys.readouterr().out
    assert f"no {best}: it is written at a validation" in printed and not best.exists()
    assert main([*begun, "--resume"]) == 0
    assert f"best agent: {best}" in capsys.readouterr().out and best.exists()


def test_help_is_printed_where_not_every_letter_can_be(monkeypatch, capsys):
    printed = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(printed, "ascii"))
    assert main(["train", "--help"]) == 0
    sys.stdout.flush()
    assert b"discount factor" in printed.getvalue() and not capsys.readouterr().err


@pytest.mark.parametrize("name", shipped_agents())
def test_today_s_program_reads_the_command_that_made_a_shipped_agent(name, monkeypatch):
    agent, begun = load_agent(name), {}

    def begin(scenario, recipe, seed, **rest):
        begun.update(scenario=scenario.name, kernels=recipe.kernels, seed=seed)
        raise KeyboardInterrupt

    if "program" not in agent.training:  # the fleet trained many runs at once
        monkeypatch.setattr(training, "trainer_of", lambda recipe: begin)
        words, seed = shlex.split(agent.training["command"]), agent.training["seed"]
        if words[3] == "study":  # which begins each run in a process of its own
            with pytest.raises(KeyboardInterrupt):
                begin(*presets(words), seed)
        else:
            assert main(words[3:]) == 130
        own = {"scenario": agent.scenario.name, "kernels": agent.recipe.kernels}
        assert begun == {**own, "seed": seed}

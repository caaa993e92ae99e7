import json
import os
import re
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest
import torch
from PIL import Image

from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.city import Cities, City
from uavdh_lite.city_generator import CityGenerator
from uavdh_lite.cli.main import main
from uavdh_lite.paper import RESULTS
from uavdh_lite.recipe import RECIPES, Recipe
from uavdh_lite.scenario import SCENARIOS, Scenario
from uavdh_lite.storage import read_table

COMMANDS = [
    "ablation",
    "app",
    "challenge",
    "cities",
    "city",
    "compare",
    "demo",
    "evaluate",
    "export",
    "fly",
    "train",
]


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


def test_demo_prints_the_table_beside_the_papers_and_draws(tmp_path, capsys):
    assert main(["demo", "--episodes", "40", "--out", str(tmp_path / "d.png")]) == 0
    output = capsys.readouterr().out
    assert "paper" in output and "94.6%" in output and "collected and landed" in output
    with Image.open(tmp_path / "d.png") as image:
        assert min(image.size) > 1000
        assert np.asarray(image).std() > 20


def test_evaluate_writes_json(tmp_path, capsys):
    arguments = ["evaluate", "--checkpoint", "manhattan", "--episodes", "60", "--seed", "9"]
    assert main([*arguments, "--json", str(tmp_path / "r.json")]) == 0
    values = json.loads((tmp_path / "r.json").read_text())
    assert list(values) == [
        "has_landed",
        "collection_ratio",
        "collection_ratio_and_landed",
        "cumulative_reward",
        "time_used",
        "safety_interventions",
        "sent_home",
    ]
    for interval in values.values():
        assert list(interval) == ["mean", "low", "high"]
        assert interval["low"] <= interval["mean"] <= interval["high"]
    first = capsys.readouterr().out
    main(arguments)
    assert capsys.readouterr().out == first


@pytest.mark.parametrize("name", sorted(RESULTS.keys() & set(shipped_agents())))
def test_shipped_agents_land_and_collect(name, tmp_path):
    path = tmp_path / "r.json"
    assert main(["evaluate", "--checkpoint", name, "--episodes", "300", "--json", str(path)]) == 0
    values = json.loads(path.read_text())
    assert values["has_landed"]["mean"] > 0.98
    assert values["collection_ratio_and_landed"]["mean"] > 0.85
    about = load_agent(name).training
    assert about["command"].startswith("python -m uavdh_lite train")


def test_compare_writes_every_episode_and_prints_shares(tmp_path, capsys):
    out = tmp_path / "table.csv.gz"
    options = ["--episodes", "3", "--replan", "50", "--others", "manhattan_ddqn_early"]
    assert main(["compare", *options, "--out", str(out)]) == 0
    output = capsys.readouterr().out
    assert "as a share of the genie's" in output
    policy, count = np.unique(read_table(out)["policy"], return_counts=True)
    assert policy.tolist() == [
        "agent",
        "genie",
        "genie_data",
        "greedy",
        "manhattan_ddqn_early",
        "random",
    ]
    assert (count == 3).all()
    about = json.loads((tmp_path / "table.json").read_text())
    assert about["command"].startswith("python -m uavdh_lite compare") and about["seed"] == 0
    assert about["agent"]["steps"] > 0


def test_fly_takes_devices_data_and_time(tmp_path, capsys):
    out = tmp_path / "f.png"
    arguments = ["fly", "--devices", "4,4", "8,9", "--data", "7.5", "10", "--flying-time", "50"]
    assert main([*arguments, "--start", "0,1", "--out", str(out)]) == 0
    output = capsys.readouterr().out
    assert "/50" in output and "/17.5" in output and "landed" in output
    assert out.stat().st_size > 10_000
    assert main(["fly", "--seed", "4", "--out", str(out)]) == 0


def test_fly_writes_a_page_that_plays_the_flight(tmp_path, capsys):
    page = tmp_path / "f.html"
    assert main(["fly", "--seed", "4", "--out", str(page)]) == 0
    data = re.search(r"data (\S+)/(\S+)\. ", capsys.readouterr().out).groups()
    assert f"{data[0]} of {data[1]} units of data" in page.read_text(encoding="utf-8")


def test_city_checks_and_draws(tmp_path, capsys):
    assert main(["city", "open_field", "--out", str(tmp_path / "c.png")]) == 0
    assert "16 × 16 cells, valid" in capsys.readouterr().out
    assert (tmp_path / "c.png").stat().st_size > 5000


def test_cities_are_drawn_and_can_be_loaded(tmp_path, capsys):
    out, figure = tmp_path / "drawn", tmp_path / "all.png"
    arguments = ["cities", "--count", "3", "--seed", "4", "--size", "9", "--largest", "12"]
    arguments += ["--kind", "blocks"]
    assert main([*arguments, "--out", str(out), "--figure", str(figure)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:3]] == [str(p) for p in sorted(out.iterdir())]
    expected = CityGenerator((9, 12), kinds=("blocks",)).draw(3, seed=4)
    assert Cities.load(out).fingerprint == expected.fingerprint
    assert lines[3:] == [str(figure)] and figure.stat().st_size > 5000


def test_train_takes_a_city_and_ranges_of_ones_own(corridor, tmp_path, capsys):
    corridor.save(tmp_path / "mine.png")
    arguments = ["train", "--city", str(tmp_path / "mine.png"), "--devices", "1", "1"]
    arguments += ["--data", "1", "4", "--flying-time", "8", "14", "--steps", "320"]
    arguments += ["--replay-prefill", "160", "--kernel-size", "3", "--huber-delta", "none"]
    arguments += ["--no-layer-norm", "--hidden", "16", "--strides", "1", "2"]
    arguments += ["--validation-episodes", "5", "--out", str(tmp_path / "run")]
    assert main(arguments) == 0
    agent = load_agent(tmp_path / "run" / "best.safetensors")
    assert agent.city.fingerprint == corridor.fingerprint
    assert agent.scenario.devices == (1, 1) and agent.scenario.data == (1.0, 4.0)
    assert agent.recipe.strides == (1, 2) and agent.recipe.hidden == (16,)
    assert agent.recipe.huber_delta is None and agent.recipe.layer_norm is False


def test_without_a_checkpoint_the_agent_flies_that_knows_the_city_best(tmp_path, capsys):
    mine, out = tmp_path / "mine.png", tmp_path / "f.png"
    CityGenerator((12, 12)).draw(1, seed=3)[0].save(mine)
    assert main(["fly", "--city", str(mine), "--out", str(out)]) == 0
    by_default = capsys.readouterr().out
    assert main(["fly", "--checkpoint", "any_city", "--city", str(mine), "--out", str(out)]) == 0
    assert capsys.readouterr().out == by_default
    table = tmp_path / "c.csv.gz"
    compare = ["compare", "--episodes", "2", "--out", str(table)]
    assert main([*compare, "--city", "random:2:5"]) == 0
    assert "any_city: 2 random missions" in capsys.readouterr().out
    assert main([*compare, "--city", "open_field"]) == 0
    assert "open_field: 2 random missions" in capsys.readouterr().out


def test_train_goes_on_from_an_agent(tmp_path, capsys):
    mine, run = tmp_path / "mine.png", tmp_path / "run"
    city = CityGenerator((12, 12)).draw(1, seed=3)[0]
    city.save(mine)
    arguments = ["train", "--from", "any_city", "--city", str(mine), "--out", str(run)]
    small = ["--steps", "320", "--replay-prefill", "160", "--validation-episodes", "5"]
    assert main([*arguments, *small]) == 0
    tuned, general = load_agent(run / "best.safetensors"), load_agent("any_city")
    assert tuned.recipe.name == "fine_tune" and tuned.scenario.name == "any_city"
    assert tuned.knows(city) and not tuned.knows(City.load("village"))
    before, after = (
        torch.cat([p.flatten() for p in a.network.parameters()]) for a in (general, tuned)
    )
    assert 0 < (after - before).abs().max() < 0.1


@pytest.mark.parametrize("command", ["train", "ablation"])
def test_help_explains_every_field(command, capsys):
    output = help_of(capsys, command)
    for config in (Recipe, Scenario) if command == "train" else (Recipe,):
        for field in fields(config):
            if field.name != "name":
                assert f"--{field.name.replace('_', '-')} " in output
                assert field.metadata["help"] in output
    assert all(name in output for name in (*RECIPES, *SCENARIOS))


@pytest.mark.parametrize("command", ["train", "ablation"])
def test_help_shows_the_values_of_the_recipe_that_is_named(command, capsys):
    for name in ("lite", "paper", "small"):
        chosen = [] if name == "lite" else ["--recipe", name]
        output = help_of(capsys, command, *chosen)
        for field in fields(Recipe):
            if field.name != "name":
                value = getattr(RECIPES[name], field.name)
                shown = " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
                shown = "none" if value is None else shown
                assert f"{field.metadata['help']} [default: {shown}]" in output, field.name


def test_help_shows_the_values_of_the_scenario_that_is_named(capsys):
    output = help_of(capsys, "train", "--kernels", "3", "--scenario=harbour", "--resume")
    assert "a folder of PNGs, or random:COUNT:SEED [default: harbour]" in output
    assert "least and most number of devices [default: 3 10]" in output
    assert "flying time, units of time [default: 50 150]" in output


def test_options_given_twice_hold_as_given_last(tmp_path, capsys):
    arguments = ["fly", "--flying-time", "40", "--flying-time", "50", "--out"]
    assert main([*arguments, str(tmp_path / "f.png")]) == 0
    assert "/50" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("train --scenario mars", "unknown scenario 'mars'"),
        ("train --recipe secret", "unknown recipe 'secret'"),
        ("train --recipe", "Parameter --recipe requires an argument"),
        ("train --recipe secret --help", "unknown recipe 'secret'"),
        ("train --discount 2", "discount is 2.0, must be at least 0 and at most 1"),
        ("train --discount much", 'Invalid value for --discount: unable to convert "much" into'),
        ("train --discoun 1", "Unknown option: --discoun. Did you mean --discount?"),
        ("train --steps 1.5", 'Invalid value for --steps: unable to convert "1.5" into int'),
        ("train --hidden 16 1.5", 'Invalid value for --hidden: unable to convert "1.5" into int'),
        ("train --seed -1", 'Invalid value "-1" for --seed. Must be >= 0'),
        ("train --seed 0.5", 'Invalid value for --seed: unable to convert "0.5" into int'),
        ("train --threads 0", 'Invalid value "0" for --threads. Choose from: 1, 2'),
        ("train --seed 99999999999999999999", "seed 99999999999999999999: must be a whole number"),
        ("train --crash-reward nan", "crash_reward is nan, must be a finite number"),
        ("train --strides 0", "strides is (0,), must be at least 1"),
        ("train --strides", "--strides requires at least 1 element"),
        ("train --exploring-spare-time -1", "exploring_spare_time is -1, must be at least 0"),
        ("train --observation polar", "unknown observation 'polar'"),
        ("fly --out flight.doc", "flight.doc: no picture format has this suffix"),
        (
            "train --device tpu",
            'Invalid value "tpu" for --device. Choose from: "cpu", "cuda"',
        ),
        ("train --devices 1", "--devices requires 2"),
        ("train --devices 1 2 3", "Unexpected: 3."),
        ("train fast", "Unexpected: fast."),
        ("train --city nowhere.png", "nowhere.png: no such file"),
        ("train --devices 1 2000", "up to 2000 devices"),
        (
            "evaluate",
            "--checkpoint requires an argument. See: python -m uavdh_lite evaluate",
        ),
        ("evaluate --checkpoint none.safetensors", "none.safetensors: no such file"),
        ("evaluate --checkpoint manhattan --episodes 0", "for --episodes. Must be > 0"),
        ("evaluate --checkpoint manhattan --city metropolis", "metropolis has 50"),
        (
            "compare --city random:1:0:60",
            "no shipped agent flies over 60 × 60 cells: train",
        ),
        ("evaluate --checkpoint any_city --city random:3", "random:3: write random:COUNT:SEED"),
        ("train --from manhattan_ddqn --city village", "has another network than the agent"),
        ("fly --devices 2,2", "device 0 stands on a building at (2, 2)"),
        ("fly --devices 4,4 4,4", "device 1 is at (4, 4), where another device stands"),
        ("fly --devices 4,4 --data -3", "device 0 has -3.0 data units"),
        ("fly --devices 4,4 --data 1 2", "1 devices but 2 amounts of data"),
        ("fly --devices 4;4", "'4;4' is not a cell"),
        ("fly --devices 4,0 4,1 4,2 4,3 4,4 4,5", "6 devices: this scenario takes 1 to 5"),
        ("fly --flying-time 0", "flying time 0: must be at least 1"),
        ("cities --count 0", "0 cities: must be at least 1"),
        ("cities --size 5", "cities: sizes is (5, 5), must be at least 8"),
        ("cities --kind castle", "kind of city: 'castle'; choose from blocks, scattered"),
        ("city atlantis", "no city named 'atlantis'"),
        ("city", "PATH requires an argument. See: python -m uavdh_lite city --help"),
        ("dance", 'Unknown command "dance". Available commands: '),
        ("", "A command is missing. See: python -m uavdh_lite --help"),
        ("challenge", "A command is missing. See: python -m uavdh_lite challenge --help"),
        ("challenge score", "SUBMISSION requires an argument"),
        ("challenge score nobody", "submission nobody: no such file, planner or shipped agent"),
        ("challenge show nowhere.json", "nowhere.json: no such leaderboard"),
        (
            "ablation --backend mpi",
            'Invalid value "mpi" for --backend. Choose from: "loky", ',
        ),
        ("compare --replan 0", 'Invalid value "0" for --replan. Must be > 0'),
        ("app --port 0", 'Invalid value "0" for --port. Must be >= 1'),
        ("app --port 65536", 'Invalid value "65536" for --port. Must be <= 65535'),
    ],
)
def test_bad_values_give_one_line_and_status_2(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in failing(capsys, *arguments.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("city manhattan --out file/c.png", "file: File exists"),
        ("evaluate --checkpoint manhattan --episodes 2 --json folder", "folder: Is a directory"),
        ("fly --mission nowhere.json", "nowhere.json: No such file or directory"),
        ("train --scenario village --recipe small --hidden 1000000000000", "not enough memory: "),
        (
            "train --scenario village --recipe small --hidden 10000000000000000",
            "not enough memory: ",
        ),
    ],
)
def test_files_and_memory_give_one_line_and_status_1(
    capsys, tmp_path, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    status = main(arguments.split())
    error = capsys.readouterr().err
    assert status == 1 and error.count("\n") == 1
    assert error.startswith(f"uavdh_lite: error: {message}")


def test_a_file_that_is_no_leaderboard(capsys, tmp_path):
    (tmp_path / "board.json").write_text('{"scores": 1}')
    assert "not a leaderboard" in failing(capsys, "challenge", "show", str(tmp_path / "board.json"))


def python(program):
    """What a Python process prints, and the modules that it has imported at its end."""
    output = subprocess.run(
        [sys.executable, "-c", f"{program}; import sys; print('imported:', *sys.modules)"],
        capture_output=True,
        env={**os.environ, "COLUMNS": "100"},
        text=True,
        check=True,
    ).stdout
    printed, imported = output.split("imported:")
    return printed, set(imported.split())


def test_importing_the_library_stays_light():
    _, imported = python("import uavdh_lite")
    assert not imported & {"numpy", "torch", "matplotlib", "cyclopts"}
    _, imported = python("import uavdh_lite.training")
    assert not imported & {"matplotlib", "ipywidgets", "cyclopts"}


@pytest.mark.parametrize("command", ["", *COMMANDS, "challenge score"])
def test_help_imports_nothing_slow_and_is_plain_text_of_the_terminals_width(command):
    arguments = [*command.split(), "--help"]
    printed, imported = python(f"from uavdh_lite.cli.main import main; main({arguments})")
    slow = {"torch", "matplotlib", "joblib", "ipywidgets", "voila"}
    if command not in ("train", "ablation"):  # they show values of recipe and scenario
        slow |= {"numpy"}
    assert "cyclopts" in imported and not imported & slow
    assert printed.startswith(f"Usage: uavdh_lite {command}") and "\x1b" not in printed
    assert max(map(len, printed.splitlines())) == 100
    if not command:
        assert all(f"│ {name} " in printed for name in COMMANDS)


@pytest.mark.parametrize(
    ("command", "package", "name"),
    [
        ("app", "voila", "app"),
        ("challenge new secret.json", "psutil", "classroom"),
        ("challenge score greedy", "psutil", "classroom"),
        ("challenge show board.json", "psutil", "classroom"),
        ("export --checkpoint manhattan", "onnxruntime", "onnx"),
        ("train --scenario village --recipe small --tensorboard", "tensorboard", "tensorboard"),
        ("ablation --recipe small --backend dask", "distributed", "dask"),
    ],
)
def test_a_missing_package_is_one_line(command, package, name, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    for module in list(sys.modules):
        if module.startswith(("uavdh_lite.labs", "uavdh_lite.course", "torch.utils.tensorboard")):
            monkeypatch.delitem(sys.modules, module)
        if module.split(".")[0] == package:
            monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setitem(sys.modules, package, None)
    error = failing(capsys, *command.split())
    assert error.endswith(f"{package} is not installed: pip install 'uavdh-lite[{name}]'\n")


@pytest.mark.parametrize(
    "device, available, message",
    [
        ("cuda", "torch.cuda.is_available", "no CUDA device: leave out --device"),
        ("mps", "torch.backends.mps.is_available", "no MPS device: leave out --device"),
    ],
)
def test_a_device_that_is_not_there_is_refused(monkeypatch, capsys, device, available, message):
    monkeypatch.setattr(available, lambda: False)
    assert main(["evaluate", "--checkpoint", "manhattan", "--device", device]) == 2
    assert message in capsys.readouterr().err

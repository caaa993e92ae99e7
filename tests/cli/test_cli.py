import json
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest
from PIL import Image

from uavdh_lite.checkpoint import load_agent, shipped_agents
from uavdh_lite.cli.main import PAPER_RESULTS, main
from uavdh_lite.recipe import Recipe


def failing(capsys, *arguments):
    """The one-line error of a command that must fail with status 2."""
    try:
        status = main(list(arguments))
    except SystemExit as exit:
        status = exit.code
    error = capsys.readouterr().err
    assert status == 2
    assert error.endswith("\n") and error.count("\n") == 1
    return error


def test_demo_prints_the_table_beside_the_papers_and_draws(tmp_path, capsys):
    assert main(["demo", "--episodes", "40", "--out", str(tmp_path / "d.png")]) == 0
    output = capsys.readouterr().out
    assert "paper" in output and "94.6%" in output and "collection ratio and landed" in output
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
    ]
    for interval in values.values():
        assert list(interval) == ["mean", "low", "high"]
        assert interval["low"] <= interval["mean"] <= interval["high"]
    first = capsys.readouterr().out
    main(arguments)
    assert capsys.readouterr().out == first


@pytest.mark.parametrize("name", sorted(PAPER_RESULTS.keys() & set(shipped_agents())))
def test_shipped_agents_land_and_collect(name, tmp_path):
    path = tmp_path / "r.json"
    assert main(["evaluate", "--checkpoint", name, "--episodes", "300", "--json", str(path)]) == 0
    values = json.loads(path.read_text())
    assert values["has_landed"]["mean"] > 0.98
    assert values["collection_ratio_and_landed"]["mean"] > 0.85
    about = load_agent(name).training
    assert about["command"].startswith("python -m uavdh_lite train")


def test_fly_takes_devices_data_and_time(tmp_path, capsys):
    out = tmp_path / "f.png"
    arguments = ["fly", "--devices", "4,4", "8,9", "--data", "7.5", "10", "--flying-time", "50"]
    assert main([*arguments, "--start", "0,1", "--out", str(out)]) == 0
    output = capsys.readouterr().out
    assert "/50" in output and "/17.5" in output and "landed" in output
    assert out.stat().st_size > 10_000
    assert main(["fly", "--seed", "4", "--out", str(out)]) == 0


def test_city_checks_and_draws(tmp_path, capsys):
    assert main(["city", "open_field", "--out", str(tmp_path / "c.png")]) == 0
    assert "16 × 16 cells, valid" in capsys.readouterr().out
    assert (tmp_path / "c.png").stat().st_size > 5000


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


def test_help_explains_every_field(capsys):
    with pytest.raises(SystemExit):
        main(["train", "--help"])
    output = " ".join(capsys.readouterr().out.split())
    for field in fields(Recipe):
        if field.name != "name":
            assert f"--{field.name.replace('_', '-')}" in output
            assert field.metadata["help"] in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("train --scenario mars", "unknown scenario 'mars'"),
        ("train --recipe secret", "unknown recipe 'secret'"),
        ("train --discount 2", "discount is 2.0, must be between 0 and 1"),
        ("train --discount much", "argument --discount: invalid float value: 'much'"),
        ("train --seed -1", "'-1' is not a whole number"),
        ("train --threads 0", "argument --threads: invalid choice: 0 (choose from 1, 2)"),
        ("train --seed 99999999999999999999", "seed 99999999999999999999: must be a whole number"),
        ("train --crash-reward nan", "crash_reward is nan, must be a finite number"),
        ("train --strides 0", "strides is (0,), must be numbers of at least 1"),
        ("train --exploring-spare-time -1", "exploring_spare_time is -1, must be 0 or above"),
        ("train --observation polar", "unknown observation 'polar'"),
        ("fly --out flight.doc", "flight.doc: no picture format has this suffix"),
        ("train --device tpu", "unknown device 'tpu'"),
        ("train --city nowhere.png", "nowhere.png: no such file"),
        ("train --devices 1 2000", "up to 2000 devices"),
        ("evaluate", "the following arguments are required: --checkpoint"),
        ("evaluate --checkpoint none.safetensors", "none.safetensors: no such file"),
        ("evaluate --checkpoint manhattan --episodes 0", "'0' is not a whole number of at least 1"),
        ("evaluate --checkpoint manhattan --city metropolis", "metropolis has 50"),
        ("fly --devices 2,2", "device 0 stands on a building at (2, 2)"),
        ("fly --devices 4,4 4,4", "device 1 is at (4, 4), where another device stands"),
        ("fly --devices 4,4 --data -3", "device 0 has -3.0 data units"),
        ("fly --devices 4,4 --data 1 2", "1 devices but 2 amounts of data"),
        ("fly --devices 4;4", "'4;4' is not a cell"),
        ("fly --devices 4,0 4,1 4,2 4,3 4,4 4,5", "6 devices: this scenario takes 1 to 5"),
        ("fly --flying-time 0", "flying time 0: must be at least 1"),
        ("city atlantis", "no city named 'atlantis'"),
        ("dance", "invalid choice: 'dance'"),
        ("", "the following arguments are required: COMMAND"),
    ],
)
def test_bad_values_give_one_line_and_status_2(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in failing(capsys, *arguments.split())


def test_an_unwritable_output_is_one_line_and_status_1(capsys, tmp_path):
    (tmp_path / "file").write_text("")
    status = main(["city", "manhattan", "--out", str(tmp_path / "file" / "c.png")])
    error = capsys.readouterr().err
    assert status == 1 and error.count("\n") == 1 and "file" in error


def test_importing_the_library_stays_light():
    program = "import sys, uavdh_lite.training; print(sorted(sys.modules))"
    loaded = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout
    assert "'matplotlib'" not in loaded and "'ipywidgets'" not in loaded


def test_the_page_says_what_to_install(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "uavdh_lite.labs.app.server", raising=False)
    monkeypatch.setitem(sys.modules, "voila", None)
    monkeypatch.setitem(sys.modules, "voila.app", None)
    assert main(["app"]) == 2
    assert "pip install 'uavdh-lite[app]'" in capsys.readouterr().err

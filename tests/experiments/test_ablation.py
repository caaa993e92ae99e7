import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load, load_agent
from uavdh_lite.errors import InputError
from uavdh_lite.experiments.ablation import (
    VALUES,
    centring,
    collect_curves,
    deviations,
    final_scores,
    find_study,
    parts,
    run_study,
    values,
)
from uavdh_lite.experiments.runs import SAVED
from uavdh_lite.recipe import LITE, PAPER, QUANTILE, SMALL
from uavdh_lite.storage import read_table

RECIPE = replace(
    SMALL,
    steps=5120,
    validation_interval=2560,
    validation_episodes=5,
    kernels=2,
    hidden=(8,),
    environments=64,
    replay_capacity=1000,
    replay_prefill=320,
)


@pytest.fixture(scope="module")
def run(corridor, corridor_scenario, tmp_path_factory):
    """A function that runs the study of centring with two seeds, over one street."""
    path = tmp_path_factory.mktemp("city") / "corridor.png"
    corridor.save(path)
    scenario = replace(corridor_scenario, city=str(path))

    def run(out, variants=None, **options):
        variants = variants or centring(RECIPE)
        return run_study(scenario, variants, 2, out, command="a command", **options)

    return run


def weights(folder):
    tensors, _ = load(folder / SAVED, "training")
    return {name: value for name, value in tensors.items() if name.startswith("online.")}


@pytest.fixture(scope="module")
def finished(run, tmp_path_factory):
    out = tmp_path_factory.mktemp("study")
    return out, run(out)


def test_a_run_for_each_variant_and_seed(finished):
    out, folders = finished
    assert folders == {
        name: [out / f"{name}-{seed}" for seed in range(2)] for name in ("centred", "non_centred")
    }
    agent = load_agent(out / "non_centred-1" / "best.safetensors")
    assert agent.recipe.observation == "non_centred" and agent.training["seed"] == 1
    assert agent.training["command"] == "a command"


def test_the_curves_of_all_runs_come_as_two_tables(finished, tmp_path):
    out, folders = finished
    paths = collect_curves(folders, tmp_path, "a command")
    for kind, path in zip(("training", "validation"), paths, strict=True):
        assert path == tmp_path / f"{kind}.csv.gz"
        table = read_table(path)
        assert list(table)[:3] == ["variant", "seed", "steps"]
        own = (table["variant"] == "non_centred") & (table["seed"] == 1)
        of_run = read_table(out / "non_centred-1" / f"{kind}.csv")
        for name, column in of_run.items():
            np.testing.assert_array_equal(table[name][own], column)
    about = json.loads((tmp_path / "about.json").read_text())
    assert about["command"] == "a command"
    assert set(about["runs"]) == {"centred-0", "centred-1", "non_centred-0", "non_centred-1"}
    assert about["runs"]["centred-1"]["seed"] == 1 and about["runs"]["centred-1"]["seconds"] > 0
    scores = final_scores(paths[1])
    last = read_table(out / "non_centred-1" / "validation.csv")["collection_ratio_and_landed"][-1]
    assert list(scores) == ["centred", "non_centred"] and scores["non_centred"][1] == last


def test_finished_runs_are_kept(run, finished):
    out, folders = finished
    before = {path: path.stat().st_mtime_ns for path in out.glob("*/*")}
    assert run(out) == folders
    assert {path: path.stat().st_mtime_ns for path in out.glob("*/*")} == before


def test_a_part_of_a_study_is_the_same_runs(run, finished, tmp_path):
    run(tmp_path, variants=find_study("centring", RECIPE, ["non_centred"]))
    assert sorted(path.name for path in tmp_path.glob("*-*")) == ["non_centred-0", "non_centred-1"]
    ours, theirs = (weights(out / "non_centred-1") for out in (tmp_path, finished[0]))
    assert all(torch.equal(ours[key], theirs[key]) for key in theirs)


def test_each_deviation_is_undone_alone():
    variants = deviations(LITE)
    assert variants.pop("all") == LITE
    assert variants["without_layer_norm"] == replace(LITE, layer_norm=False)
    assert variants["without_learning_rate"].learning_rate == PAPER.learning_rate
    assert len(variants) == 11 and all(recipe != LITE for recipe in variants.values())
    assert deviations(PAPER) == {"all": PAPER}
    assert set(centring(LITE)) == {"centred", "non_centred"}


def test_a_map_of_another_kind_is_the_third_variant_of_centring():
    variants = centring(QUANTILE)
    assert list(variants) == ["centred", "non_centred", "global_local"]
    assert variants["global_local"] == QUANTILE
    whole = variants["centred"]
    assert (whole.kernel_size, whole.strides) == (LITE.kernel_size, LITE.strides)
    assert whole.data_scale == LITE.data_scale and whole.quantiles == QUANTILE.quantiles
    assert replace(whole, observation="non_centred") == variants["non_centred"]


def test_each_part_is_left_out_alone():
    variants = parts(QUANTILE)
    assert variants["all"] == QUANTILE
    assert replace(variants["none"], steps=LITE.steps) == LITE
    assert variants["without_quantiles"] == replace(
        QUANTILE, quantiles=0, huber_delta=LITE.huber_delta
    )
    unguarded = variants["without_failsafe"]
    assert not unguarded.failsafe and unguarded.crash_reward == LITE.crash_reward
    for name, recipe in variants.items():
        assert recipe.steps == QUANTILE.steps and (name == "all" or recipe != QUANTILE)


def test_each_value_is_changed_alone():
    variants = values(QUANTILE)
    assert variants.pop("as_it_is") == QUANTILE
    assert "8_quantiles" not in variants  # as it is
    assert variants["32_quantiles"] == replace(QUANTILE, quantiles=32)
    for name, recipe in variants.items():
        changed = {
            field for field, value in vars(recipe).items() if value != getattr(QUANTILE, field)
        }
        assert changed == set(VALUES[name]), name


def test_unknown_study_variant_and_backend(run, tmp_path):
    with pytest.raises(InputError, match="unknown study 'weather': choose one of centring, dev"):
        find_study("weather", LITE)
    with pytest.raises(InputError, match="unknown variant 'sideways': choose from centred, non_"):
        find_study("centring", LITE, ["centred", "sideways"])
    with pytest.raises(InputError, match="unknown backend 'mpi': choose loky or dask"):
        run(tmp_path, backend="mpi")


def test_runs_too_short_for_a_curve_are_refused_before_they_run(run, tmp_path):
    variants = centring(replace(RECIPE, steps=4000))
    with pytest.raises(InputError, match="runs of 4000 steps: a study's curves need at least 500"):
        run(tmp_path / "a", variants=variants)
    assert not (tmp_path / "a").exists()

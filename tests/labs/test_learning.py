"""DDQN in JavaScript learns as in Python: gradients, Adam's step, targets; and every dial acts."""

import base64
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from uavdh_lite.checkpoint import load_agent
from uavdh_lite.city import City, load_city
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.recipe import SMALL
from uavdh_lite.replay import Batch
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream, torch_seed
from uavdh_lite.training import Trainer

VILLAGE = load_city("village")
ODD = City.from_text("odd", "LL...\nLL.B.\n..NB.\n.....\n.b..N")  # whose windows need more cells
DIALS = {**SMALL.as_json(), "double": True, "frozen": False, "seed": 0}


def run_of(city: City, **dials) -> dict:
    scenario = {**asdict(find_scenario("village")), "name": "it"}
    told = {"name": city.name, "rows": city.text.split()}
    return {"city": told, "scenario": scenario, "dials": DIALS | dials}


CASES = [  # city, dials
    (VILLAGE, {}),
    (VILLAGE, {"double": False, "layer_norm": True, "data_scale": 20.0, "time_scale": 10.0}),
    (VILLAGE, {"observation": "non_centred", "amsgrad": False}),
    (ODD, {"layer_norm": True, "frozen": True, "kernels": 4, "hidden": (9, 7)}),
]


@pytest.fixture(scope="module")
def cases(rows_of):
    """Updates in Python, and the questions about the same ones."""
    made = []
    for number, (city, dials) in enumerate(CASES):
        fields = {name: value for name, value in dials.items() if hasattr(SMALL, name)}
        recipe = replace(SMALL, **fields, learning_rate_end=None)
        environment = Environment(city)
        observation = recipe.observation_for(environment)
        torch.manual_seed(torch_seed(Use.EXERCISE, number))
        network = recipe.network_for(observation)
        for weight in network.parameters():  # biases that are not 0
            weight.data += 0.03 * torch.randn_like(weight)
        learner = recipe.learner_for(observation, network)
        generator, count = stream(Use.EXERCISE, number), 24
        scenario = find_scenario("village")
        state, after = (
            scenario.sample_anywhere(environment, count, generator, 3) for _ in range(2)
        )
        action = generator.integers(0, 6, count)
        reward = generator.normal(0, 3, count).astype(np.float32)
        discount = generator.choice(np.float32([0, 0.95]), count)
        weights = {name: w.ravel().tolist() for name, w in network.state_dict().items()}
        pairs = zip(rows_of(state), rows_of(after), action, reward, discount, strict=True)
        batch = [
            {"state": s, "next": n, "action": int(a), "reward": float(r), "discount": float(d)}
            for s, n, a, r, d in pairs
        ]
        run = run_of(city, **dials, learning_rate_end=None)
        question = {"run": run, "weights": weights, "batch": batch, "updates": 3}
        made.append((learner, Batch(state, action, reward, discount, after), dials, question))
    return made


def test_gradients_steps_and_targets_are_those_of_torch(cases, ask):
    answers = ask("learning.js", {"updates": [question for *_, question in cases]})["updates"]
    for (learner, batch, dials, _), found in zip(cases, answers, strict=True):
        near = {"rtol": 1e-5, "atol": 1e-5}
        if not dials.get("double", True):

            def single(batch, learner=learner):
                best = learner.target(*learner.observation(batch.next_state)).amax(1)
                return learner.tensor(batch.reward) + learner.tensor(batch.discount) * best.detach()

            learner.targets = single
        learner.target_update_rate = 0 if dials.get("frozen") else learner.target_update_rate
        np.testing.assert_allclose(
            found["values"], learner.q_values(batch.state).ravel(), **near, err_msg=str(dials)
        )
        np.testing.assert_allclose(found["targets"], learner.targets(batch), **near)
        for gradients, loss in zip(found["gradients"], found["losses"], strict=True):
            assert loss == pytest.approx(float(learner.update(batch)), rel=1e-4)
            for name, weight in learner.online.named_parameters():
                scale = float(weight.grad.abs().max()) + 1e-3
                given = np.array(gradients[name]) / scale
                np.testing.assert_allclose(
                    given, weight.grad.ravel() / scale, atol=1e-5, err_msg=f"{name} {dials}"
                )
        for network, weights in ((learner.online, "online"), (learner.target, "target")):
            for name, weight in network.named_parameters():
                np.testing.assert_allclose(
                    found[weights][name], weight.detach().ravel(), atol=2e-5, err_msg=name
                )


STEPS, TURN = 45, 30  # of 16 environments; an update each from a memory of 320 on
QUICK = {"steps": 16 * STEPS, "replay_prefill": 320}
NO_PRICE = {"crash_reward": 0, "crash_reward_end": None, "movement_reward": 0}
TURNED = {  # what is turned after some steps
    "usual": {},
    "frozen": {"frozen": True},
    "no punishment": NO_PRICE,
    "memory": {"replay_capacity": 64},
    "rate": {"learning_rate": 1e-12},
    "three steps": {"return_steps": 3},
    "discount": {"discount": 0.5},
    "temperature": {"temperature": 3.0},
}


@pytest.fixture(scope="module")
def runs(ask):
    told = [
        {"run": run_of(VILLAGE, **QUICK), "steps": STEPS, "turns": {TURN: turned}}
        for turned in TURNED.values()
    ]
    told.append({"run": run_of(VILLAGE, **QUICK, frozen=True), "steps": STEPS})
    found = ask("learning.js", {"runs": told})["runs"]
    return dict(zip([*TURNED, "frozen from the start"], found, strict=True))


def same(one: dict, other: dict) -> bool:
    return all(np.array_equal(one[name], other[name]) for name in one)


def test_a_dial_acts_while_it_learns(runs):
    usual = runs["usual"]
    assert usual["told"][-1]["updates"] == STEPS - 19  # one a step once there are 320 transitions
    assert not same(usual["target"], usual["first"])
    assert all(reward < -4 for reward in usual["crashes"]) and usual["crashes"]
    assert set(usual["discounts"]) <= {0, 0.95} and usual["different"] == 64
    for name in set(TURNED) - {"usual"}:
        assert not same(runs[name]["online"], usual["online"]), name
    frozen, begun = runs["frozen"], runs["frozen from the start"]
    assert same(begun["target"], begun["first"]) and not same(begun["online"], begun["first"])
    assert not same(frozen["target"], usual["target"])
    assert all(reward > -2 for reward in runs["no punishment"]["crashes"])
    assert usual["landings"] and not any(runs["no punishment"]["landings"])
    assert usual["most"] == find_scenario("village").devices[1]
    assert runs["memory"]["recent"] and not usual["recent"]
    assert runs["memory"]["told"][-1]["count"] == 64
    assert runs["rate"]["told"][-1]["learningRate"] < 1e-12
    assert set(np.round(runs["three steps"]["discounts"], 6)) <= {0, round(0.95**3, 6)}
    assert set(runs["discount"]["discounts"]) <= {0, 0.5}
    assert runs["temperature"]["told"][-1]["temperature"] == 3


def test_the_price_of_a_crash_grows_and_the_learning_rate_falls_with_the_run(runs):
    first, last = (runs["usual"]["told"][k] for k in (0, -1))
    assert first["crashReward"] == pytest.approx(-5, abs=0.5) and last["crashReward"] == -20
    assert first["learningRate"] == pytest.approx(2e-3, rel=0.05) and last["learningRate"] == 0


def test_python_loads_an_agent_of_the_labs_and_it_lands_as_often(runs, tmp_path):
    file = tmp_path / "agent.safetensors"
    file.write_bytes(base64.b64decode(runs["usual"]["file"]))
    agent = load_agent(file)
    assert agent.trained_in[0].text == VILLAGE.text
    assert agent.recipe.learning_rate == SMALL.learning_rate
    flights = evaluate(agent.environment, agent, agent.scenario, 200, 0).metrics()
    point = runs["usual"]["points"][-1]
    assert flights["landed"].mean == pytest.approx(point["landed"], abs=0.2)
    assert flights["collected_and_landed"].mean == pytest.approx(point["home"], abs=0.2)


@pytest.mark.longest
@pytest.mark.long
def test_three_seeds_end_within_the_spread_of_the_librarys(tmp_path, ask):
    steps, seeds, file = 48_000, range(3), tmp_path / "agent.safetensors"
    recipe = replace(SMALL, steps=steps)
    questions = [
        {"run": run_of(VILLAGE, steps=steps, seed=seed), "steps": steps // 16} for seed in seeds
    ]
    found: dict[str, list[float]] = {"labs": [], "library": []}
    answers = ask("learning.js", {"runs": questions})["runs"]
    for seed, learned in zip(seeds, answers, strict=True):
        file.write_bytes(base64.b64decode(learned["file"]))
        trainer = Trainer(find_scenario("village"), recipe, seed)
        while not trainer.finished:
            trainer.step()
        for name, agent in (("labs", load_agent(file)), ("library", trainer.agent)):
            flights = evaluate(agent.environment, agent, agent.scenario, 500, 0)
            found[name].append(flights.metrics()["collected_and_landed"].mean)
    print(found)
    lowest, highest = min(found["library"]), max(found["library"])
    spread = highest - lowest
    assert all(lowest - spread <= each <= highest + spread for each in found["labs"]), found

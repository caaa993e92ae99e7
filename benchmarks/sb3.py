"""Stable-Baselines3's DQN and PPO beside our DDQN in the village, at equal environment steps.

    python benchmarks/sb3.py

All meet the same task and reward: a crash costs 20, a step 0.1. They discount by 0.95 and are
evaluated greedily on the same 200 missions. Each of Stable-Baselines3's learners runs with its own
network, which has no convolutions, and with the one of our recipe but for the layer norms. PPO
learns to draw its actions, so `ppo_drawn` draws them in the evaluation, too. The other settings of
Stable-Baselines3 are its own but for those named below; nothing was tuned. Writes
`data/runs/sb3-village`.
"""

import time
from dataclasses import replace
from functools import partial
from itertools import product

import gymnasium
import joblib
import torch
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import Tensor, nn

from uavdh_lite.bridges.gymnasium import ID, as_policy
from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment, Rewards
from uavdh_lite.evaluation import Policy, evaluate
from uavdh_lite.network import convolutions
from uavdh_lite.provenance import provenance
from uavdh_lite.recipe import LITE
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.streams import Use
from uavdh_lite.training import Trainer

# `lite` for a village and half a minute
QUICK = replace(
    LITE,
    name="quick",
    steps=48_000,
    kernels=8,
    kernel_size=3,
    strides=(2, 2),
    hidden=(128, 128),
    learning_rate=2e-3,
    batch_size=64,
    environments=16,
    replay_capacity=40_000,
    replay_prefill=2_000,
    temperature=1.0,
    crash_reward=-5.0,
    crash_reward_end=-20.0,
    crash_reward_growth=0.75,
    validation_interval=8_000,
    validation_episodes=200,
)
OUT = "data/runs/sb3-village"
STEPS, BETWEEN = 48_000, 8_000  # environment steps of a run, and between two evaluations
TASK = {"scenario": "village", "rewards": Rewards(crash=-20.0, movement=-0.1)}
LEARNERS = {"dqn": DQN, "ppo": PPO}
SETTINGS = {
    "dqn": {"train_freq": 4, "target_update_interval": 500, "learning_starts": 1000},
    "ppo": {"n_steps": 128, "batch_size": 256},
}
SETTINGS["dqn"] |= {"exploration_fraction": 0.5, "batch_size": 64}


class Convolutions(BaseFeaturesExtractor):
    """What comes before the fully connected layers of our network."""

    def __init__(self, space: gymnasium.spaces.Dict):
        shape, r = space["map"].shape, QUICK
        layers, features = convolutions(shape, r.kernels, r.kernel_size, r.strides, r.leak)
        super().__init__(space, features + 1)
        self.convolutions = layers

    def forward(self, seen: dict[str, Tensor]) -> Tensor:
        return torch.cat([self.convolutions(seen["map"]), seen["time"]], dim=1)


NETWORKS = {
    "": {},
    "_convolutions": {
        "features_extractor_class": Convolutions,
        "net_arch": list(QUICK.hidden),
        "activation_fn": partial(nn.LeakyReLU, QUICK.leak),
    },
}


def row(variant: str, seed: int, steps: int, seconds: float, policy: Policy) -> dict:
    """A policy's means over the missions; the seconds are of one core."""
    scenario, environment = find_scenario("village"), Environment(load_city("village"))
    metrics = evaluate(environment, policy, scenario, 200, 0, Use.VALIDATION).metrics()
    about = {"variant": variant, "seed": seed, "steps": steps, "seconds": round(seconds, 1)}
    names = ("landed", "collected_and_landed", "return")
    return about | {name: metrics[name].mean for name in names}


def ours(seed: int) -> list[dict]:
    """One run of our DDQN; a row for each evaluation."""
    recipe = replace(QUICK, steps=STEPS)
    trainer, rows, spent = Trainer(find_scenario("village"), recipe, seed), [], 0.0
    for target in range(BETWEEN, STEPS + 1, BETWEEN):
        started = time.process_time()
        while trainer.steps < target:
            trainer.step()
        spent += time.process_time() - started
        rows.append(row("ddqn", seed, target, spent, trainer.agent))
    return rows


def theirs(name: str, network: str, seed: int) -> list[dict]:
    """One run of Stable-Baselines3; a row for each evaluation and way to act."""
    envs = make_vec_env(ID, n_envs=1 if name == "dqn" else 8, seed=seed, env_kwargs=TASK)
    settings = SETTINGS[name] | {"learning_rate": 5e-4, "gamma": 0.95, "seed": seed}
    settings["policy_kwargs"] = NETWORKS[network]
    model = LEARNERS[name]("MultiInputPolicy", envs, device="cpu", **settings)
    env = gymnasium.make(ID, **TASK)
    rows, started, idle = [], time.process_time(), 0.0

    def evaluated(*_) -> bool:
        nonlocal idle
        if model.num_timesteps % BETWEEN == 0:
            before = time.process_time()
            for way in (True, False) if name == "ppo" else (True,):
                act = partial(model.predict, deterministic=way)
                policy = as_policy(env, lambda seen, act=act: act(seen)[0])
                variant = name + network + ("" if way else "_drawn")
                about = (variant, seed, model.num_timesteps, before - started - idle)
                rows.append(row(*about, policy))
            idle += time.process_time() - before
        return True

    model.learn(STEPS, callback=evaluated)
    return rows


def run(name: str, network: str, seed: int) -> list[dict]:
    torch.set_num_threads(1)
    return ours(seed) if name == "ddqn" else theirs(name, network, seed)


if __name__ == "__main__":
    learners = [*product(LEARNERS, NETWORKS), ("ddqn", "")]
    runs = [(*learner, seed) for learner in learners for seed in range(3)]
    parts = joblib.Parallel(2, verbose=11)(joblib.delayed(run)(*one) for one in runs)
    write_table(f"{OUT}.csv.gz", [row for part in parts for row in part])
    write_json(f"{OUT}.json", {"command": "python benchmarks/sb3.py", **provenance()})

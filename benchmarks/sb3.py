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
from uavdh_lite.network import WholeFrame, convolutions
from uavdh_lite.provenance import provenance
from uavdh_lite.recipe import LITE, SMALL
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.streams import Use
from uavdh_lite.training import Trainer

STEPS = 48_000
OF_SMALL = ("kernels", "kernel_size", "strides", "hidden", "learning_rate", "batch_size")
OF_SMALL += ("environments", "replay_capacity", "replay_prefill")
OF_SMALL += ("crash_reward", "crash_reward_end", "crash_reward_growth", "validation_episodes")
# `lite` for a village and half a minute
QUICK = replace(LITE, steps=STEPS, temperature=1.0, **{k: getattr(SMALL, k) for k in OF_SMALL})
OUT = "data/runs/sb3-village"
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
        (channels, side, _), r = space["map"].shape, QUICK
        frame = WholeFrame(side, r.kernel_size, r.strides)
        layers, features = convolutions(
            channels, frame.side, r.kernels, r.kernel_size, r.strides, r.leak
        )
        super().__init__(space, features + 1)
        self.convolutions = nn.Sequential(frame, layers)

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


def row(variant: str, seed: int, seconds: float, policy: Policy) -> dict:
    """A policy's means over the missions; the seconds are of one core."""
    scenario, environment = find_scenario("village"), Environment(load_city("village"))
    metrics = evaluate(environment, policy, scenario, 200, 0, Use.VALIDATION).metrics()
    about = {"variant": variant, "seed": seed, "steps": STEPS, "seconds": round(seconds, 1)}
    return about | {key: metrics[key].mean for key in ("landed", "collected_and_landed", "return")}


def ours(seed: int) -> list[dict]:
    """One run of our DDQN."""
    trainer, started = Trainer(find_scenario("village"), QUICK, seed), time.process_time()
    while not trainer.finished:
        trainer.step()
    return [row("ddqn", seed, time.process_time() - started, trainer.agent)]


def theirs(name: str, network: str, seed: int) -> list[dict]:
    """One run of Stable-Baselines3; a row for each way to act."""
    envs = make_vec_env(ID, n_envs=1 if name == "dqn" else 8, seed=seed, env_kwargs=TASK)
    settings = SETTINGS[name] | {"learning_rate": 5e-4, "gamma": 0.95, "seed": seed}
    settings["policy_kwargs"] = NETWORKS[network]
    model = LEARNERS[name]("MultiInputPolicy", envs, device="cpu", **settings)
    env, rows, started = gymnasium.make(ID, **TASK), [], time.process_time()
    model.learn(STEPS)
    seconds = time.process_time() - started
    for way, end in (("", True), ("_drawn", False)) if name == "ppo" else (("", True),):
        act = partial(model.predict, deterministic=end)
        policy = as_policy(env, lambda seen, act=act: act(seen)[0])
        rows.append(row(f"{name}{network}{way}", seed, seconds, policy))
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

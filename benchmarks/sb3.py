"""Stable-Baselines3's DQN and PPO beside our DDQN in the village, at equal environment steps.

    python benchmarks/sb3.py [--steps 48000] [--seeds 3] [--jobs 2] [--out data/runs/sb3-village]

All meet the same task and reward (a crash costs 20, a step 0.1), discount by 0.95, and are
evaluated greedily on the same 200 scenarios; PPO, which learns to draw its actions, also by drawing
them (`ppo_drawn`). The settings of Stable-Baselines3 are its own but for those named below; nothing
was tuned. Writes a CSV table, and JSON beside it.
"""

import argparse
import time
from pathlib import Path

import gymnasium
import joblib
import torch

STEPS_BETWEEN = 8000
SETTINGS = {
    "dqn": {"learning_rate": 5e-4, "train_freq": 4, "target_update_interval": 500},
    "ppo": {"learning_rate": 5e-4, "n_steps": 128, "batch_size": 256},
}
SETTINGS["dqn"] |= {"learning_starts": 1000, "exploration_fraction": 0.5, "batch_size": 64}


def train(algorithm: str, seed: int, steps: int) -> list[dict]:
    """One run; a row for each evaluation."""
    torch.set_num_threads(1)
    return ours(seed, steps) if algorithm == "ddqn" else theirs(algorithm, seed, steps)


def row(algorithm: str, seed: int, steps: int, seconds: float, flights) -> dict:
    metrics = flights.metrics()
    names = ("has_landed", "collection_ratio_and_landed", "cumulative_reward")
    about = {"algorithm": algorithm, "seed": seed, "steps": steps, "seconds": round(seconds, 1)}
    return about | {name: metrics[name].mean for name in names}


def ours(seed: int, steps: int) -> list[dict]:
    from dataclasses import replace

    from uavdh_lite.evaluation import evaluate
    from uavdh_lite.experiments.runs import keep_freed_memory
    from uavdh_lite.recipe import find_recipe
    from uavdh_lite.scenario import find_scenario
    from uavdh_lite.streams import Use
    from uavdh_lite.training import Trainer

    keep_freed_memory()
    trainer = Trainer(find_scenario("village"), replace(find_recipe("small"), steps=steps), seed)
    rows, spent = [], 0.0
    for target in range(STEPS_BETWEEN, steps + 1, STEPS_BETWEEN):
        started = time.perf_counter()
        while trainer.steps < target:
            trainer.step()
        spent += time.perf_counter() - started
        parts = (trainer.environment, trainer.agent, trainer.scenario)
        rows.append(row("ddqn", seed, target, spent, evaluate(*parts, 200, 0, Use.VALIDATION)))
    return rows


def theirs(algorithm: str, seed: int, steps: int) -> list[dict]:
    from stable_baselines3 import DQN, PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.env_util import make_vec_env

    from uavdh_lite import gym
    from uavdh_lite.city import City
    from uavdh_lite.environment import Environment, Rewards
    from uavdh_lite.evaluation import evaluate
    from uavdh_lite.scenario import find_scenario
    from uavdh_lite.streams import Use

    options = {"scenario": "village", "rewards": Rewards(crash=-20.0, movement=-0.1)}
    places = 1 if algorithm == "dqn" else 8
    envs = make_vec_env(gym.ID, n_envs=places, seed=seed, env_kwargs=options)
    model = {"dqn": DQN, "ppo": PPO}[algorithm](
        "MultiInputPolicy", envs, gamma=0.95, seed=seed, device="cpu", **SETTINGS[algorithm]
    )

    def policy(deterministic: bool):
        return gym.as_policy(
            gymnasium.make(gym.ID, **options),
            lambda batch: model.predict(batch, deterministic=deterministic)[0],
        )

    policies = {algorithm: policy(deterministic=True)}
    if algorithm == "ppo":
        policies["ppo_drawn"] = policy(deterministic=False)
    environment, scenario = Environment(City.load("village")), find_scenario("village")
    rows, started, idle = [], time.perf_counter(), 0.0

    class Evaluate(BaseCallback):
        def _on_step(self) -> bool:
            nonlocal idle
            if self.num_timesteps % STEPS_BETWEEN == 0:
                before = time.perf_counter()
                seconds = before - started - idle
                for name, each in policies.items():
                    flights = evaluate(environment, each, scenario, 200, 0, Use.VALIDATION)
                    rows.append(row(name, seed, self.num_timesteps, seconds, flights))
                idle += time.perf_counter() - before
            return True

    model.learn(steps, callback=Evaluate())
    return rows


def main() -> None:
    from uavdh_lite.provenance import provenance
    from uavdh_lite.storage import write_json, write_table

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=48_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("data/runs/sb3-village"))
    options = parser.parse_args()
    runs = [(name, seed) for name in ("dqn", "ppo", "ddqn") for seed in range(options.seeds)]
    parts = joblib.Parallel(n_jobs=options.jobs, verbose=5)(
        joblib.delayed(train)(name, seed, options.steps) for name, seed in runs
    )
    write_table(options.out.with_suffix(".csv.gz"), [row for part in parts for row in part])
    command = f"python benchmarks/sb3.py --steps {options.steps} --seeds {options.seeds}"
    write_json(options.out.with_suffix(".json"), {"command": command, **provenance()})


if __name__ == "__main__":
    main()

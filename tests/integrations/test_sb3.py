"""Stable-Baselines3 trains on the Gymnasium environment as it is."""

import gymnasium
import pytest
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import uavdh_lite.gym  # noqa: F401 (registers)
from uavdh_lite.environment import Rewards

SETTINGS = {
    DQN: {
        "learning_rate": 5e-4,
        "batch_size": 64,
        "learning_starts": 500,
        "train_freq": 2,
        "target_update_interval": 200,
        "exploration_fraction": 0.5,
    },
    PPO: {"learning_rate": 1e-3, "batch_size": 128, "n_steps": 512, "n_epochs": 4},
}


def environment():
    """The village, with a crash that costs little: it is learned sooner."""
    rewards = Rewards(crash=-10.0)
    return Monitor(
        gymnasium.make("uavdh_lite/DataHarvesting-v0", scenario="village", rewards=rewards)
    )


def test_its_checker_finds_no_fault():
    # It would warn that maps are no pictures of bytes: they are not meant to be.
    check_env(environment().unwrapped, warn=False)


@pytest.mark.parametrize("algorithm", [DQN, PPO])
def test_the_return_rises(algorithm):
    def mean_return(model):
        flown = environment()
        flown.reset(seed=9)
        return evaluate_policy(model, flown, 60, deterministic=algorithm is DQN)[0]

    model = algorithm(
        "MultiInputPolicy",
        environment(),
        gamma=0.95,
        seed=0,
        device="cpu",
        **SETTINGS[algorithm],
    )
    before = mean_return(model)
    model.learn(5_000)
    assert mean_return(model) > before + 2

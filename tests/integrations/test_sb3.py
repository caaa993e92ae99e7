"""Stable-Baselines3 trains on the Gymnasium environment as it is."""

import gymnasium
import pytest
from sb3_contrib import MaskablePPO
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


def test_maskable_ppo_learns_within_the_failsafe_and_never_crashes():
    """It finds `action_masks` by itself; one crash would show in the return of its episode."""
    env = Monitor(gymnasium.make("uavdh_lite/DataHarvesting-v0", scenario="village", failsafe=True))
    model = MaskablePPO(
        "MultiInputPolicy", env, seed=0, device="cpu", n_steps=256, batch_size=64, n_epochs=2
    )
    corrected = []

    def watch(found, _):
        corrected.extend(
            info["sent_home"] or info["safety_intervention"] for info in found["infos"]
        )
        return True

    model.learn(1_500, callback=watch)
    returns = env.get_episode_rewards()
    assert len(corrected) >= 1_500 and not any(corrected), "it took an action that is masked"
    assert len(returns) > 40 and min(returns) > -35 * 0.2

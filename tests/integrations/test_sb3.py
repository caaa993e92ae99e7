"""Stable-Baselines3 trains on the Gymnasium environment as it is."""

import gymnasium
import pytest
from sb3_contrib import MaskablePPO
from stable_baselines3.common.env_checker import check_env

from uavdh_lite.beyond.failsafe import SafeEnvironment
from uavdh_lite.bridges.gymnasium import ID, as_policy
from uavdh_lite.city import City
from uavdh_lite.evaluation import evaluate

pytestmark = pytest.mark.long

QUICK = {"learning_rate": 1e-3, "batch_size": 128, "n_epochs": 4, "seed": 0, "device": "cpu"}


def test_maskable_ppo_learns_and_flies_within_the_failsafe():
    """It finds `action_masks` by itself, and takes no action that is masked."""
    environment = SafeEnvironment(City.load("village"))
    env = gymnasium.make(ID, scenario="village", environment=environment)
    check_env(env.unwrapped, warn=False)  # it would warn that maps are no pictures of bytes
    model = MaskablePPO("MultiInputPolicy", env, n_steps=256, **QUICK)
    infos = []
    model.learn(1_500, callback=lambda found, _: not infos.extend(found["infos"]))
    assert len(infos) >= 1_500
    assert not any(info["sent_home"] or info["safety_interventions"] for info in infos)
    policy = as_policy(
        env, lambda seen, masks: model.predict(seen, action_masks=masks)[0], masked=True
    )
    flights = evaluate(environment, policy, env.unwrapped.scenario, 50, seed=0)
    assert flights.end.landed.all() and not any(map(any, flights.counts.values()))

"""Checks for the exercises: `checks.rate_from_snr(rate)`, and `checks.rate_from_snr.hint()`.

A check takes an answer, prints that it is right, or raises `CheckFailed` with what is probably
wrong with it. `EXERCISES` has them all by name, in the order of the notebooks.
"""

# isort: off
from uavdh_lite.course.checks.first_flight import flight_score, flown_by_hand
from uavdh_lite.course.checks.channel import rate_from_snr, path_loss_crossover, mean_rate
from uavdh_lite.course.checks.shadowing import crosses, shadow_map, asymmetric_share
from uavdh_lite.course.checks.environment import tdma_slot, rewards_by_hand, reward, safe_step
from uavdh_lite.course.checks.observation import city_cell, centre, network_weights
from uavdh_lite.course.checks.ddqn import (
    stable_policy,
    ring_buffer,
    double_target,
    soft_update_in_place,
)
from uavdh_lite.course.checks.training import n_step_return, diagnosis, mended_recipe
from uavdh_lite.course.checks.ablation import steps_to, permutation_p, ablation_reading
from uavdh_lite.course.checks.evaluation import wilson, episodes_needed, lead, policy
from uavdh_lite.course.checks.scenarios import reachable, defeat
from uavdh_lite.course.checks.labs import failure_seed, worst_device_cell
from uavdh_lite.course.checks.beyond import (
    failsafe_mask,
    quantile_loss,
    advantage_target,
    longest_way,
)
from uavdh_lite.course.checks.any_city import (
    small_city_map,
    symmetric_q,
    clustered_half_width,
)

# isort: on
from uavdh_lite.course.checks.exercise import EXERCISES, CheckFailed, Exercise

__all__ = [
    "EXERCISES",
    "CheckFailed",
    "Exercise",
    "ablation_reading",
    "advantage_target",
    "asymmetric_share",
    "centre",
    "city_cell",
    "clustered_half_width",
    "crosses",
    "defeat",
    "diagnosis",
    "double_target",
    "episodes_needed",
    "failsafe_mask",
    "failure_seed",
    "flight_score",
    "flown_by_hand",
    "lead",
    "longest_way",
    "mean_rate",
    "mended_recipe",
    "n_step_return",
    "network_weights",
    "path_loss_crossover",
    "permutation_p",
    "policy",
    "quantile_loss",
    "rate_from_snr",
    "reachable",
    "reward",
    "rewards_by_hand",
    "ring_buffer",
    "safe_step",
    "shadow_map",
    "small_city_map",
    "soft_update_in_place",
    "stable_policy",
    "steps_to",
    "symmetric_q",
    "tdma_slot",
    "wilson",
    "worst_device_cell",
]

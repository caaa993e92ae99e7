"""A stronger rule than the greedy one: the best order of devices that the time allows.

In the orienteering problem a traveller with limited time chooses which places to visit, and in
which order, for the largest sum of prizes. Here the places are devices, and the prizes what they
hold. The rule knows what the greedy one knows: the map, and not how fast a link is.
"""

from functools import cache
from itertools import permutations

import numpy as np

from uavdh_lite import registry
from uavdh_lite.environment import State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import in_flight
from uavdh_lite.planners import Greedy

MOST_DEVICES = 6  # they have 1957 orders, and one more has 13,700


class Orienteering(Greedy):
    """Fly towards the first device of the best order, which is sought again at every step.

    An order is a sequence of some of the devices. It takes the moves from one to the next, a unit
    of time over each, and the way home. The best one has the most data among those for which the
    time suffices, and takes the least time among equals.

    Raises `InputError` for missions of more than `MOST_DEVICES` devices.
    """

    def act(self, state: State) -> np.ndarray:
        return in_flight(state, self._act)

    def _act(self, state: State) -> np.ndarray:
        city, devices = state.city, state.device_cells.shape[1]
        # Stop 0 is where the UAV is, stop k the cell from which device k is served
        goals = self.approach[city[:, None], state.device_cells]
        stop = np.concatenate([state.uav_cell[:, None], goals], axis=1)
        moves = self.moves[city[:, None, None], stop[:, :, None], stop[:, None]].astype(int)
        home = self.environment.time_to_land[city[:, None], stop].astype(int)
        time, data = [home[:, :1]], [np.zeros((len(state), 1))]
        for order in orders(devices):  # all of one length at a time
            there = moves[:, 0, order[:, 0]] + moves[:, order[:, :-1], order[:, 1:]].sum(axis=2)
            time.append(there + order.shape[1] + home[:, order[:, -1]])
            data.append(state.data_left[:, order - 1].sum(axis=2))
        took, brought = np.concatenate(time, axis=1), np.concatenate(data, axis=1)
        worth = np.where(took <= state.time_left[:, None], brought - 1e-4 * took, -np.inf)
        worth[:, 0] = np.maximum(worth[:, 0], -1)  # the empty order is always one
        first = np.concatenate([[0], *(order[:, 0] for order in orders(devices))])
        chosen = first[worth.argmax(axis=1)]
        action = self.towards(city, state.uav_cell, stop[np.arange(len(state)), chosen])
        return np.where(chosen == 0, super().act(state), action)


@cache
def orders(devices: int) -> list[np.ndarray]:
    """All sequences of 1, 2, … of the numbers 1 to `devices`; a (number, length) array each."""
    if devices > MOST_DEVICES:
        raise InputError(
            f"orienteering over {devices} devices: at most {MOST_DEVICES} are possible"
        )
    numbers = range(1, devices + 1)
    return [np.array(list(permutations(numbers, length))) for length in numbers]


registry.register("policy", "orienteering", lambda environment, seed: Orienteering(environment))

"""Double deep Q-learning for a UAV that collects data: all of it, in one file.

    python -m uavdh_lite.one_file --png village.png  # about a minute on one quiet core

A UAV flies over a village, collects data from one or two devices, and must land before its time is
up (Bayerlein et al., Globecom 2020). The world is imported: `Environment` moves a batch of UAVs, a
`Scenario` draws their missions. What learns is written out, in the order in which it is used:

    CentredMap      what the network sees: the city, shifted so that the UAV is in the middle
    QNetwork        what each of the six actions is worth
    softmax_policy  draws an action for each UAV: the better, the likelier
    Memory          keeps what happened, as states, and draws minibatches
    double_target   what the network should have said
    update          a step of gradient descent; the target network follows
    evaluate        flies missions that no training has seen, without exploring
    train           the loop

From the same inputs each part computes what the library's does, to the bit (`observation` to
`training`). The library goes on to keep the best network of a run; here the last one counts.
"""

import argparse
import copy
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from uavdh_lite.city import load_city
from uavdh_lite.environment import Environment, Rewards, State
from uavdh_lite.evaluation import FunctionPolicy, fly
from uavdh_lite.plotting import Figure, draw_trajectory, save_figure
from uavdh_lite.scenario import find_scenario
from uavdh_lite.streams import Use, stream, torch_seed

VILLAGE = find_scenario("village")


@dataclass
class Settings:
    """The constants, those of the recipe `small`. The paper's text gives none. What departs from
    the authors' code has the value there, and the reason."""

    steps: int = 144_000  # 1,000,000: a village has a quarter of their city's cells, and no hours
    uavs: int = 16  # 1: they fly side by side, one update for a step of all, so flying is cheap
    discount: float = 0.95  # γ
    target_rate: float = 0.005  # τ
    learning_rate: float = 2e-3  # 3e-5 throughout: few updates; falls to 0: the last ones settle
    batch: int = 64  # 128: half the price of an update, and still four steps a UAV on average
    memory: int = 40_000  # 50,000: a shorter run
    prefill: int = 2_000  # 25,000: random steps before the first update
    temperature: float = 0.1  # β, constant
    # The departure that decides: 150 from the start. Who dreads a crash before knowing how much
    # there is to collect lands at once. So the price grows; rewards in the memory keep theirs.
    crash_at_first: float = 5.0
    crash_at_last: float = 20.0

    def crash(self, step: int) -> float:
        """The price of a crash after so many steps."""
        share = min(step / (0.75 * self.steps), 1.0)
        return self.crash_at_first + share * (self.crash_at_last - self.crash_at_first)


class CentredMap:
    """`see(state) -> (map, time)`: what the network sees of a batch of states (III-C).

    The map, (B, 5, 2M − 1, 2M − 1), has five layers: landing zone, no-fly zone, buildings, data
    left, data collected. It holds the whole city of M × M cells wherever the UAV is. What lies
    outside may not be entered. The time, (B, 1), is the flying time left. No unit is scaled.
    """

    def __init__(self, environment: Environment):
        self.environment, city, self.size = environment, environment.cities[0], environment.size
        self.side, self.layers = 2 * self.size - 1, 5
        layers = ((city.landing, 0), (city.no_fly, 1), (city.buildings, 0))
        padded = [np.pad(own, self.size - 1, constant_values=out) for own, out in layers]
        # windows[:, r, c]: the part of the padded city whose middle is the city's cell (r, c)
        window = self.side, self.side
        self.windows = np.lib.stride_tricks.sliding_window_view(np.stack(padded), window, (1, 2))

    def __call__(self, state: State) -> tuple[Tensor, Tensor]:
        row, col = np.divmod(state.uav_cell, self.size)
        maps = np.zeros((len(state), 5, self.side, self.side), np.float32)
        maps[:, :3] = self.windows[:, row, col].swapaxes(0, 1)
        rows, cols = np.divmod(state.device_cells, self.size)  # of K devices, (B, K)
        south, east = (rows.T - row).T + self.size - 1, (cols.T - col).T + self.size - 1
        place = np.arange(len(state))[:, None], south, east
        np.add.at(maps[:, 3], place, state.data_left)
        np.add.at(maps[:, 4], place, state.data_collected)
        return torch.from_numpy(maps), torch.tensor(state.time_left).float()[:, None]


class QNetwork(nn.Module):
    """`network(map, time) -> q`, the value of each action, (B, 6) (Fig. 2). The authors' has 16
    kernels of 5 × 5 that move by 1, and 3 layers of 256: over their city 80 times the weights."""

    def __init__(self, side: int, layers: int = 5):
        super().__init__()
        self.convolutions = nn.Sequential(
            nn.Conv2d(layers, 8, 3, 2), nn.ReLU(), nn.Conv2d(8, 8, 3, 2), nn.ReLU(), nn.Flatten()
        )
        inputs = 8 * ((side - 3) // 4) ** 2 + 1  # what the convolutions make of it, and the time
        self.head = nn.Sequential(
            nn.Linear(inputs, 128), nn.ReLU(), nn.Linear(128, 128), nn.ReLU(), nn.Linear(128, 6)
        )
        for weights in self.parameters():  # as the authors' framework, Keras, begins
            nn.init.xavier_uniform_(weights) if weights.dim() > 1 else nn.init.zeros_(weights)

    def forward(self, maps: Tensor, time: Tensor) -> Tensor:
        return self.head(torch.cat([self.convolutions(maps), time], dim=1))


def softmax_policy(q: Tensor, temperature: float, generator: np.random.Generator) -> np.ndarray:
    """An action for each row: a with a probability proportional to exp(Q(s, a) / β) (eq. 10)."""
    below = torch.softmax(q / temperature, dim=1).double().cumsum(dim=1).numpy()
    drawn = generator.random(len(q))[:, None] * below[:, -1:]  # the last sum may be under 1
    return (below[:, :-1] <= drawn).sum(axis=1)


class Memory:
    """A ring of the last steps. Each minibatch holds the newest step of each UAV, so that each is
    learned from at least once (combined experience replay, III-B; Zhang and Sutton, 2017)."""

    def __init__(self, capacity: int, uavs: int):
        self.capacity, self.uavs, self.stored = capacity // uavs * uavs, uavs, 0
        self.ring: list[np.ndarray] = []

    def __len__(self) -> int:
        return min(self.stored, self.capacity)

    def add(self, state: State, action: np.ndarray, reward: np.ndarray, after: State) -> None:
        """Store a step of each UAV in the place of the oldest ones."""
        step = [*vars(state).values(), action, reward, *vars(after).values()]
        if not self.ring:
            self.ring = [np.zeros((self.capacity, *part.shape[1:]), part.dtype) for part in step]
        place = self.stored % self.capacity
        for ring, part in zip(self.ring, step, strict=True):
            ring[place : place + self.uavs] = part
        self.stored += self.uavs

    def sample(self, count: int, generator: np.random.Generator) -> tuple:
        """The newest step of each UAV, and others, all equally likely: s, a, r, s'."""
        others = generator.choice(len(self) - self.uavs, count - self.uavs, replace=False)
        ago, uav = np.divmod(np.r_[: self.uavs, self.uavs + others], self.uavs)  # backwards in time
        places = (self.stored - (ago + 1) * self.uavs + uav) % self.capacity
        drawn = [ring[places] for ring in self.ring]
        fields = len(drawn) // 2 - 1  # of a state
        state, (action, reward), after = drawn[:fields], drawn[fields:-fields], drawn[-fields:]
        return State(*state), torch.from_numpy(action), torch.from_numpy(reward), State(*after)


def double_target(
    reward: Tensor, ended: Tensor, discount: float, online_next: Tensor, target_next: Tensor
) -> Tensor:
    """y = r + γ Q̄(s', argmax_a Q(s', a)), and r alone where the episode ended; (B,) (eq. 8).
    One network alone overrates what it has chosen."""
    best = online_next.argmax(dim=1, keepdim=True)  # the online network chooses,
    return reward + discount * ~ended * target_next.gather(1, best)[:, 0]  # the target one judges


def update(online, target, optimiser, see: CentredMap, batch: tuple, settings: Settings) -> Tensor:
    """A step downhill on the squared error (eq. 7), then a soft update; returns the loss."""
    state, action, reward, after = batch
    with torch.no_grad():  # y is a number to reach: it does not move towards Q
        ended, seen = torch.tensor(after.ended), see(after)
        y = double_target(reward, ended, settings.discount, online(*seen), target(*seen))
    q = online(*see(state)).gather(1, action[:, None])[:, 0]
    loss = nn.functional.mse_loss(q, y)
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()
    with torch.no_grad():
        for old, new in zip(target.parameters(), online.parameters(), strict=True):
            old.lerp_(new, settings.target_rate)  # θ̄ ← (1 − τ) θ̄ + τ θ
    return loss.detach()


@torch.no_grad()
def evaluate(network: nn.Module, see: CentredMap, missions: int = 200) -> tuple:
    """Mean landed, and collected and landed, of the best actions (eq. 9) in missions kept apart."""
    generator = stream(Use.VALIDATION)
    state = VILLAGE.sample(see.environment, missions, generator)
    while not state.ended.all():
        best = network(*see(state)).argmax(dim=1).numpy()
        state, _ = see.environment.step(state, best, generator)
    return state.landed.mean(), (state.collected * state.landed).mean()


def train(settings: Settings, see: CentredMap, seed: int = 0) -> Iterator[tuple]:
    """The loop. After a step of all UAVs it hands out the steps so far and the network."""
    generator, uavs, environment = stream(Use.TRAINING, seed), settings.uavs, see.environment
    torch.manual_seed(torch_seed(Use.WEIGHTS, seed))
    online = QNetwork(see.side, see.layers)
    target = copy.deepcopy(online)
    optimiser = torch.optim.Adam(online.parameters(), eps=1e-7, amsgrad=True, fused=True)
    memory = Memory(settings.memory, uavs)
    state = VILLAGE.sample(environment, uavs, generator)
    for step in range(0, settings.steps, uavs):
        # Act, at random at first
        if len(memory) < settings.prefill:
            action = generator.integers(0, 6, uavs)
        else:
            with torch.no_grad():
                action = softmax_policy(online(*see(state)), settings.temperature, generator)
        # Step, all at once
        after, outcome = environment.step(state, action, generator)
        reward = Rewards(crash=-settings.crash(step))(outcome)
        # Remember, and begin new missions where one has ended
        memory.add(state, action, reward, after)
        ended = np.flatnonzero(after.ended)
        state = after.with_rows(ended, VILLAGE.sample(environment, len(ended), generator))
        # Learn
        if len(memory) >= settings.prefill:
            optimiser.param_groups[0]["lr"] = settings.learning_rate * (1 - step / settings.steps)
            batch = memory.sample(settings.batch, generator)
            update(online, target, optimiser, see, batch, settings)
        yield step + uavs, online


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=Settings.steps, help="more than 2,000")
    parser.add_argument("--png", help="a file for the curve and a flight")
    given = parser.parse_args()
    torch.set_num_threads(1)  # quickest for so small a network
    settings, see, curve = Settings(given.steps), CentredMap(Environment(load_city("village"))), []
    print("      steps  landed  collected and landed")
    for step, network in train(settings, see, given.seed):
        if step * 18 // settings.steps > (step - settings.uavs) * 18 // settings.steps:
            curve.append((step, *evaluate(network, see)))
            print("{:>11,}{:>8.0%}{:>7.0%} ".format(*curve[-1]), "█" * round(40 * curve[-1][2]))
    if not given.png:
        return
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot([point[0] for point in curve], [point[1:] for point in curve])
    left.legend(["landed", "collected and landed"])
    left.set(xlabel="environment steps", ylabel="share of data, or of missions", ylim=(0, 1.03))
    best = FunctionPolicy(lambda state: network(*see(state)).argmax(dim=1).numpy())
    world, generator = see.environment, stream(Use.TEST)
    flight = fly(world, best, VILLAGE.sample(world, 1, generator), generator)
    draw_trajectory(right, world, flight.trajectory(0))
    save_figure(figure, given.png)


if __name__ == "__main__":
    main()

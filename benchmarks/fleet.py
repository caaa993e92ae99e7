"""Many runs of the recipe `plain` at once on one accelerator: seeds and variants, stacked.

    python benchmarks/fleet.py observation=centred observation=non_centred --seeds 3 --minutes 60

Variants are written as for the command `study`. Runs whose networks have the same shape make a
**fleet**. All tensors of a fleet begin with an axis of its R runs, so a step of all of them takes
as many kernels as a step of one. A kernel here is so small that it takes longer to launch than to
compute. Therefore the kernels of a step are recorded once, as a **CUDA graph**, and launched
together from then on. Each fleet has a thread and a stream of its own. Without CUDA, the same
functions run one by one: slow, but good for tests.

Each run is a `Trainer` of the library: it makes the environment, the first weights and the
missions, keeps the rows of the tables, and writes the files. Only its steps are computed here:

- What depends on cells alone is looked up in tables, made by the library (`World`).
- Missions come from the library's generator of the run, some thousands ahead, and are taken in
  turn. Fading, exploration and minibatches come from the device's own generator. So a run here is
  one of the same kind as the library's of that seed, and not the same one.
- A minibatch is drawn with replacement: it may hold an older transition twice.

The folder `OUT/VARIANT-SEED` has the files of the command `train`. When `--minutes` are over, the
runs are saved, and the same command continues them.
"""

import argparse
import math
import shlex
import sys
import time
import traceback
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from uavdh_lite.checkpoint import save_agent
from uavdh_lite.city import City
from uavdh_lite.ddqn import ddqn_target
from uavdh_lite.environment import ACTIONS, LAND, REPORTED, State
from uavdh_lite.errors import InputError
from uavdh_lite.experiments.runs import (
    SAVED,
    identity,
    require_whole,
    resume_run,
    save_run,
)
from uavdh_lite.experiments.study import variants_of
from uavdh_lite.network import QNetwork
from uavdh_lite.observation import Observation
from uavdh_lite.recipe import PLAIN, Recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.storage import write_json, write_table
from uavdh_lite.streams import Use, stream, torch_seed
from uavdh_lite.training import BIN, CURVES, VALIDATION_SEED, Trainer
from uavdh_lite.training import EPISODES_PER_GREEDY_FLIGHT as PER_FLIGHT

FLIGHTS = 64  # greedy flights for a row of the learning curve, at most
POOL = 4096  # missions drawn ahead for a run; shared out among its environments
CHUNK = 1000  # steps that the device makes before the host looks after the runs, at most
VECTORS = ("online", "target", "exp_avg", "exp_avg_sq", "max_exp_avg_sq")  # of P numbers each
# Of a recipe, what may differ from `plain`
FREE = ("name", "steps", "observation", "kernels", "kernel_size", "strides", "hidden", "batch_size")
FREE += ("environments", "replay_capacity", "replay_prefill", "learning_rate", "kept_by")
FREE += ("temperature", "crash_reward", "validation_interval", "validation_episodes")
# Columns of the plan
HEAT, RATE, ROOT, HEAD, FILLED = range(5)


def require_plain(recipe: Recipe, cities: tuple[City, ...]) -> None:
    """Raise `InputError` for several cities, and for parts of a recipe that no fleet computes."""
    if len(cities) > 1:
        raise InputError(f"a fleet flies over a single city, not over {len(cities)}")
    values, usual = recipe.as_json(), PLAIN.as_json()
    other = {name: value for name, value in values.items() if value != usual.get(name)}
    if unknown := other.keys() - set(FREE):
        raise InputError(f"a fleet runs `plain` alone, not with another {', '.join(unknown)}")


def packed(state: State) -> np.ndarray:
    """A row of numbers for each episode: cell, time left, and K each of device cells, data at the
    start and data left; (B, 2 + 3K) float32."""
    first = state.uav_cell[:, None], state.time_left[:, None]
    rest = state.device_cells, state.data_initial, state.data_left
    return np.concatenate([*first, *rest], axis=1, dtype=np.float32)


def unpacked(rows: np.ndarray) -> State:
    """The episodes, none of them landed, that `packed` made rows of."""
    devices = (rows.shape[1] - 2) // 3
    cell, time_left, *rest = np.split(rows, [1, 2, 2 + devices, 2 + 2 * devices], axis=1)
    return State(
        uav_cell=cell[:, 0].astype(np.int16),
        time_left=time_left[:, 0].astype(np.int16),
        device_cells=rest[0].astype(np.int16),
        data_initial=rest[1].copy(),
        data_left=rest[2].copy(),
        landed=np.zeros(len(rows), bool),
        city=np.zeros(len(rows), np.int16),
    )


class World:
    """The city as tables on the device, and what is computed from them for packed states.

    | table | shape | content |
    | --- | --- | --- |
    | `moves` | (n · 6, 3) | next cell, whether the action is replaced, whether it lands |
    | `radio` | (n · 6 · n, 2δ) | of a device: the mean of the SNR in each slot and the fading's σ |
    | `windows` | (n, W² · channels) | the map without devices |
    | `spots` | (n · n,) | where a device's data left is in the flattened map |

    n is the number of cells; the first axis is the UAV's cell (and its action), then the device's
    cell. The SNR is in bits, log2(SNR), because a slot uploads log2(1 + SNR) data units.
    """

    def __init__(self, observation: Observation, devices: int, device: str):
        environment, self.devices = observation.environment, devices
        self.cells, self.slots = environment.size**2, environment.channel.slots
        self.time_scale, self.data_scale = observation.time_scale, observation.data_scale
        self.map_shape = observation.map_shape
        cells, count = np.arange(self.cells), len(ACTIONS)
        lands = ~environment.forbidden[0] & (np.arange(count) == LAND)
        moves = np.stack([environment.next_cell[0], environment.forbidden[0], lands], axis=-1)

        # With neither distance nor noise, only the fading is left: its standard deviation
        none = {"path_loss_exponent_los": 0.0, "path_loss_exponent_nlos": 0.0}
        none["cell_edge_snr_db"] = 0.0
        still = replace(environment, channel=replace(environment.channel, **none))
        everywhere = self._states(np.tile(cells, (self.cells, 1)))
        fading = np.ones((self.cells, self.slots, self.cells), np.float32)
        radio = np.empty((self.cells, count, self.cells, 2, self.slots), np.float32)
        for action in range(count):
            after = environment.next_cell[0, :, action]
            mean = environment.snr_db(everywhere, after, 0 * fading).transpose(0, 2, 1)
            radio[:, action, :, 0] = mean
            radio[:, action, :, 1] = still.snr_db(everywhere, after, fading).transpose(0, 2, 1)
        radio *= np.float32(math.log2(10) / 10)

        windows = observation(self._states(np.zeros((self.cells, devices))))[0]
        windows = windows.permute(0, 2, 3, 1).flatten(1)
        top, left = np.divmod(cells, environment.size)
        if observation.kind == "non_centred":
            corner = observation.size - 1 - (observation.width - environment.size) // 2
            top = left = np.full(self.cells, corner)
        spots = observation._in_window(cells, top[:, None], left[:, None])
        spots = spots * self.map_shape[0] + 3

        self.moves = torch.tensor(moves.reshape(-1, 3), dtype=torch.float32, device=device)
        self.radio = torch.tensor(radio.reshape(-1, 2 * self.slots), device=device)
        self.windows = windows.to(device)
        self.nothing, self.silence = torch.tensor([0.0, -torch.inf], device=device)
        self.spots = torch.tensor(spots.ravel(), device=device)

    def _states(self, device_cells: np.ndarray) -> State:
        """The UAV over each cell, devices without data at these; (n, K)."""
        n, nothing = self.cells, np.zeros(device_cells.shape, np.float32)
        whole, zero = device_cells.astype(np.int16), np.zeros(n, np.int16)
        return State(np.arange(n), zero + 1, whole, nothing, nothing, zero > 0, zero)

    def observe(self, states: Tensor) -> tuple[Tensor, Tensor]:
        """The maps and times that networks take, as `Observation` makes them of states."""
        cell, K = states[..., 0].long(), self.devices
        devices, initial, left = states[..., 2:].unflatten(-1, (3, K)).unbind(-2)
        spots = self.spots[cell[..., None] * self.cells + devices.long()]
        spots = torch.cat([spots, spots + 1], dim=-1)
        data = torch.cat([left, initial - left], dim=-1) / self.data_scale
        maps = self.windows[cell].scatter_add_(-1, spots, data)
        maps = maps.unflatten(-1, (*self.map_shape[1:], self.map_shape[0]))
        return maps.movedim(-1, -3), states[..., 1:2] / self.time_scale

    def transition(
        self, states: Tensor, action: Tensor, fading: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """`Environment.transition` of episodes that are not over.

        Returns the states after it; data uploaded, and whether the step did not land, was replaced
        by the safety controller, and crashed, (..., 4); and whether the episode is over, bool.
        """
        cell, K = states[..., 0].long(), self.devices
        taken = cell * len(ACTIONS) + action
        devices, initial, left = states[..., 2:].unflatten(-1, (3, K)).unbind(-2)
        next_cell, replaced, lands = self.moves[taken].unbind(-1)
        time_left = states[..., 1] - 1
        radio = self.radio[taken[..., None] * self.cells + devices.long()]  # (..., K, 2δ)
        snr = radio[..., : self.slots] + radio[..., self.slots :] * fading.mT
        over = (time_left <= 0) | (lands > 0)
        offered = functional.softplus(snr, beta=math.log(2))  # log2(1 + SNR)
        offered = torch.where(over[..., None, None], self.nothing, offered)
        before = left
        for slot in range(self.slots):  # each goes to the device that is heard best
            heard = torch.where(left > 0, snr[..., slot], self.silence)
            served = heard == heard.amax(-1, keepdim=True)
            left = left - served * torch.minimum(offered[..., slot], left)
        uploaded = (before - left).sum(-1)
        crashed = over * (1 - lands)
        first = torch.stack([next_cell, time_left], dim=-1)
        after = torch.cat([first, devices, initial, left], dim=-1)
        return after, torch.stack([uploaded, 1 - lands, replaced, crashed], dim=-1), over


class Networks:
    """Q-values of many networks of one shape at once, their weights stacked.

    A network's parameters are one vector of P numbers, in torch's order, padded to whole groups of
    four. A matrix lies in it as (inputs, outputs), and so do a convolution's kernels.
    """

    def __init__(self, network: QNetwork):
        self.frame, self.layers = network.frame, [*network.convolutions, *network.head]
        self.shapes = {name: weight.shape for name, weight in network.named_parameters()}
        self.sizes = [shape.numel() for shape in self.shapes.values()]
        self.padding = -sum(self.sizes) % 4

    def vector(self, weights: list[Tensor]) -> Tensor:
        """Parameters in torch's shapes as one vector, (P,)."""
        parts = [w.flatten(1).T.flatten() if w.dim() > 1 else w for w in weights]
        return functional.pad(torch.cat(parts), (0, self.padding))

    def weights(self, vector: Tensor) -> dict[str, Tensor]:
        """The parameters by name in torch's shapes, from one vector, (P,)."""
        parts = zip(self.shapes.items(), self.views(vector[None]), strict=True)
        return {
            name: (part[0].T if len(shape) > 1 else part[0]).reshape(shape).clone()
            for (name, shape), part in parts
        }

    def views(self, vectors: Tensor) -> list[Tensor]:
        """The stacked matrices, (R, inputs, outputs), and vectors, (R, outputs); (R, P) given."""
        parts = vectors.split([*self.sizes, self.padding], dim=1)
        shapes = self.shapes.values()
        return [
            part.unflatten(1, (-1, shape[0])) if len(shape) > 1 else part
            for part, shape in zip(parts, shapes, strict=False)
        ]

    def __call__(self, weights: list[Tensor], maps: Tensor, times: Tensor) -> Tensor:
        """Q-values (R, B, 6) of R networks' maps, (R, B, channels, W, W), and times, (R, B, 1)."""
        framed = self.frame(maps.flatten(0, 1)).unflatten(0, maps.shape[:2])
        x, parts = framed.movedim(-3, -1), iter(weights)
        for layer in self.layers:
            if isinstance(layer, nn.Conv2d):
                x = self._convolved(x, layer, next(parts), next(parts))
            elif isinstance(layer, nn.Linear):
                weight, bias = next(parts), next(parts)
                x = torch.baddbmm(bias[:, None], x, weight)
            elif isinstance(layer, nn.LeakyReLU):  # of slope 0
                x = functional.relu(x)
            else:  # flattened
                x = torch.cat([x.movedim(-1, -3).flatten(2), times], dim=2)
        return x

    def _convolved(self, x: Tensor, layer: nn.Conv2d, weight: Tensor, bias: Tensor) -> Tensor:
        """A convolution as one product of matrices: each row is what a kernel sees of a map."""
        side, stride = layer.kernel_size[0], layer.stride[0]
        seen = x.unfold(2, side, stride).unfold(3, side, stride)  # (R, B, H, W, channels, k, k)
        runs, count, rows, cols, *_ = seen.shape
        seen = seen.reshape(runs, count * rows * cols, -1)
        return torch.baddbmm(bias[:, None], seen, weight).view(runs, count, rows, cols, -1)


class Captured:
    """A function that always reads and writes the same tensors; with CUDA, recorded as a graph.

    Arguments:
        function: takes and returns nothing.
        tensors: those that it changes; they are as before after the recording.
        generator: where its random numbers come from.
        stream: where it is recorded, and will run; None without CUDA. Two graphs that are recorded
            on one stream share the memory in which products of matrices are computed, so they may
            not run at the same time.
        reference: what the result is compared with; the function itself if None.
    """

    def __init__(
        self,
        function: Callable[[], None],
        tensors: list[Tensor],
        generator: torch.Generator,
        stream: torch.cuda.Stream | None,
        reference: Callable[[], None] | None = None,
    ):
        self.function, self.graph = function, None
        before, drawn = [tensor.clone() for tensor in tensors], generator.get_state()

        def rewind() -> None:
            for tensor, value in zip(tensors, before, strict=True):
                tensor.copy_(value)
            generator.set_state(drawn)

        def results(step: Callable[[], None]) -> list[Tensor]:
            rewind()
            step()
            return [tensor.clone() for tensor in tensors]

        if stream is None:
            return
        torch.cuda.synchronize()
        with torch.cuda.stream(stream):
            for _ in range(3):  # what is made at the first calls must not be recorded
                results(function)
            expected = results(reference or function)
            rewind()
        torch.cuda.synchronize()
        try:
            graph = torch.cuda.CUDAGraph()
            graph.register_generator_state(generator)
            with torch.cuda.graph(graph, stream=stream, capture_error_mode="thread_local"):
                function()
            self.graph = graph
        except Exception as error:
            print(f"no CUDA graph, so this will be slow: {error}", file=sys.stderr, flush=True)
            torch.cuda.synchronize()
        with torch.cuda.stream(stream):
            found = results(self)
            rewind()
        torch.cuda.synchronize()
        pairs = zip(expected, found, strict=True)
        furthest = max(((a - b).abs() / (1 + a.abs())).max().item() for a, b in pairs)
        print(f"recorded: within {furthest:.1g} of the function", file=sys.stderr, flush=True)

    def __call__(self) -> None:
        self.graph.replay() if self.graph else self.function()


class Fleet:
    """R runs of N environments each, whose tensors are stacked; a step of all is one call.

    | tensor | shape | content |
    | --- | --- | --- |
    | `vectors` | (5, R, P) | weights of both networks, Adam's moments |
    | `lanes` | (R, N, F + 1) | packed states, the return so far |
    | `memory` | (R, L, N, F + 3) | packed states; action, reward, whether the episode ended |
    | `pool` | (R, N, missions, F + 1) | the lanes at the start of the missions to come |
    | `cursor` | (R, N) | the next mission |
    | `plan` | (CHUNK, R, 5) | what depends on the step, for the next steps |
    | `now` | (1,) | the step in the plan |
    | `log` | (CHUNK, R, N, 4) | whether an episode ended, return, landed, collected |
    | `losses` | (CHUNK, R) | |

    Arguments:
        runs: their recipes are equal but for their names.
        compiled: `torch.compile` joins small kernels before the recording.
    """

    def __init__(self, runs: list["Run"], device: str, compiled: bool = False):
        self.runs, self.trainers = runs, [run.trainer for run in runs]
        self.device, first = device, runs[0].trainer
        self.recipe = recipe = first.recipe
        require_plain(recipe, first.environment.cities)
        self.R, self.N, self.K = len(runs), recipe.environments, first.scenario.max_devices
        self.F, self.L = 2 + 3 * self.K, len(first.replay.action)
        self.world = World(first.learner.observation, self.K, device)
        self.networks = Networks(first.learner.online)
        self.adam = first.learner.optimiser.param_groups[0]
        self.generator = torch.Generator(device)
        seed = torch_seed(Use.TRAINING, first.seed) + first.steps
        self.generator.manual_seed(seed % 2**63)
        self._upload()
        plain = parts = (self._act, self._advance, self._loss, self._adam)
        if compiled:
            parts = tuple(torch.compile(part, dynamic=False) for part in plain)
        changed = [self.vectors, self.lanes, self.memory, self.cursor, self.now]
        changed += [self.log, self.losses]
        self.stream = torch.cuda.Stream() if self.generator.device.type == "cuda" else None
        self.fill, self.learn = (
            Captured(
                partial(self.step, learning, parts),
                *(changed, self.generator, self.stream),
                reference=partial(self.step, learning, plain),
            )
            for learning in (False, True)
        )
        self.validation = Flights(self, recipe.validation_episodes)
        missions = stream(Use.VALIDATION, VALIDATION_SEED)
        state = first.scenario.sample(first.environment, recipe.validation_episodes, missions)
        self.validation_missions = np.repeat(packed(state)[None], self.R, axis=0)
        self.greedy = Flights(self, len(self.validation_missions[0, :FLIGHTS]))

    def _upload(self) -> None:
        """Make the tensors from the trainers."""
        R, N, F, B = self.R, self.N, self.F, self.recipe.batch_size
        missions = max(POOL // N, 16)
        zeros = partial(torch.zeros, device=self.device)
        vectors, lanes, memory = [], [], []
        for trainer in self.trainers:
            tensors, shapes = trainer.learner.state_dict(), self.networks.shapes
            of_name = {
                name: [tensors.get(f"{of}.{name}", torch.zeros(shape)) for of in VECTORS]
                for name, shape in shapes.items()
            }  # no moments before the first update
            parts = zip(*of_name.values(), strict=True)
            vectors.append(torch.stack([self.networks.vector(list(part)) for part in parts]))
            lanes.append(np.concatenate([packed(trainer.state), trainer.returns[:, None]], axis=1))
            replay = trainer.replay
            flat = {k: v.reshape(-1, *v.shape[2:]) for k, v in replay.states.items()}
            rest = np.stack([replay.action, replay.reward, replay.terminal], axis=-1)
            rows = packed(State(**flat)).reshape(self.L, N, F)
            memory.append(np.concatenate([rows, rest], axis=-1, dtype=np.float32))
        self.vectors = torch.stack(vectors, dim=1).to(self.device).contiguous()
        own = self.networks.views(self.vectors[0])
        self.leaves = [part.detach().requires_grad_() for part in own]
        self.both = self.networks.views(self.vectors[:2].flatten(0, 1))
        self.lanes = torch.tensor(np.stack(lanes), dtype=torch.float32, device=self.device)
        self.memory = torch.tensor(np.stack(memory), device=self.device)
        self.pool = torch.tensor(
            np.stack([starts(one, N * missions) for one in self.trainers]), device=self.device
        ).unflatten(1, (N, missions))
        self.cursor = torch.zeros(R, N, dtype=torch.long, device=self.device)
        self.taken = np.zeros((R, N), int)  # missions taken before this chunk
        self.renewed = np.zeros((R, N), int)  # those of them in whose place new ones are
        self.now = torch.zeros(1, dtype=torch.long, device=self.device)
        self.plan, self.log = zeros(CHUNK, R, 5), zeros(CHUNK, R, N, 4)
        self.losses = zeros(CHUNK, R)
        self.fading, self.uniform = zeros(R, N, self.world.slots, self.K), zeros(R, B)
        self.exponential = zeros(R, N, len(ACTIONS))
        self.usual = torch.tensor(astuple(REPORTED), device=self.device)
        learned = astuple(self.recipe.training_rewards_at(0))
        self.rewards = torch.tensor(learned, device=self.device)
        place = torch.arange(B, device=self.device)
        self.older, self.newest = (place >= N).float(), place.clamp(max=N)
        self.run = torch.arange(R, device=self.device)[:, None]
        self.lane = torch.arange(N, device=self.device)

    # One step, in the order of `Trainer.step`

    @torch.no_grad()
    def step(self, learning: bool, parts: tuple[Callable, ...]) -> None:
        """One step of all environments of all runs and, if they learn already, one update each."""
        act, advance, loss_of, adam = parts
        plan = self.plan.index_select(0, self.now)[0]
        self.fading.normal_(generator=self.generator)
        self.exponential.exponential_(generator=self.generator)
        action = act(self.lanes, plan) if learning else self.exponential.argmax(dim=-1)
        lanes, rows, log, over = advance(self.lanes, action)
        place = torch.stack([plan[0, HEAD], (plan[0, HEAD] + 1) % self.L]).long()
        self.memory.index_copy_(1, place, rows)
        self.log.index_copy_(0, self.now, log[None])
        self.lanes.copy_(lanes)
        self.cursor += over
        if learning:
            self.uniform.uniform_(generator=self.generator)
            with torch.enable_grad():
                loss = loss_of(self.leaves, plan)
                gradients = torch.autograd.grad(loss.sum(), self.leaves)
            adam(gradients, plan)
            self.losses.index_copy_(0, self.now, loss.detach()[None])
        self.now += 1

    def _act(self, lanes: Tensor, plan: Tensor) -> Tensor:
        """Actions of the softmax policy (eq. 10); of all logits, with Gumbel's noise, the largest.

        In the prefill the heat, one over the temperature, is 0, and all are equally likely.
        """
        q_values = self.networks(self.leaves, *self.world.observe(lanes[..., : self.F]))
        return (q_values * plan[:, HEAT, None, None] - self.exponential.log()).argmax(dim=-1)

    def _advance(self, lanes: Tensor, action: Tensor):
        """The lanes after a step, new missions in place of those ended; two rows of the memory,
        this step's and the state after it; what is logged; and which episodes are over."""
        states, total = lanes[..., : self.F], lanes[..., self.F]
        after, what, over = self.world.transition(states, action, self.fading)
        reward, total = (what * self.rewards).sum(-1), total + (what * self.usual).sum(-1)
        of_this = torch.stack([action.float(), reward, over.float()], dim=-1)
        rows = torch.stack(
            [torch.cat([states, of_this], -1), torch.cat([after, of_this], -1)],
            dim=1,
        )
        initial, left = after[..., 2 + self.K :].unflatten(-1, (2, self.K)).sum(-1).unbind(-1)
        ended = [over.float(), total, 1 - what[..., 1], (initial - left) / initial]
        missions = self.pool.shape[2]
        mission = self.pool[self.run, self.lane, self.cursor % missions]
        going_on = torch.cat([after, total[..., None]], dim=-1)
        lanes = torch.where(over[..., None], mission, going_on)
        return lanes, rows, torch.stack(ended, dim=-1), over

    def sample(self, plan: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Minibatches of transitions, the newest of each environment first.

        Returns the states s and s', (2, R, B, F), the action, the reward and the discount, (R, B).
        """
        N = self.N
        choices = (plan[:, FILLED, None] - 1) * N  # but the newest N
        number = (self.uniform * choices * self.older).long() + self.newest
        age, lane = number // N, number % N
        first = (plan[:, HEAD, None].long() - age) % self.L
        both = torch.stack([first, (first + 1) % self.L])
        rows = self.memory[self.run, both, lane]
        action, reward, ended = rows[0, ..., self.F :].unbind(-1)
        return rows[..., : self.F], action.long(), reward, self.recipe.discount * (1 - ended)

    def _loss(self, leaves: list[Tensor], plan: Tensor) -> Tensor:
        """The loss of each run in a minibatch of its own, (R,); see `DDQN`."""
        states, action, reward, discount = self.sample(plan)
        return self.loss_of(leaves, states, action, reward, discount)

    def loss_of(self, leaves, states, action, reward, discount) -> Tensor:
        """The loss of each run for these transitions."""
        maps, times = self.world.observe(states)
        with torch.no_grad():  # the Q-values of s' by the online and the target network
            twice = maps[1].repeat(2, 1, 1, 1, 1), times[1].repeat(2, 1, 1)
            after = self.networks(self.both, *twice)
            after = after.unflatten(0, (2, -1)).flatten(1, 2)
            y = ddqn_target(reward.flatten(), discount.flatten(), *after).view_as(reward)
        q = self.networks(leaves, maps[0], times[0]).gather(-1, action[..., None])[..., 0]
        return functional.mse_loss(q, y, reduction="none").mean(-1)

    def _adam(self, parts: list[Tensor], plan: Tensor) -> None:
        """Adam's step (torch.optim.Adam), and the target network's."""
        parts = [part.flatten(1) for part in parts]
        gradient = torch.cat([*parts, parts[0].new_zeros(self.R, self.networks.padding)], dim=1)
        online, target, mean, square, largest = self.vectors
        beta1, beta2 = self.adam["betas"]
        mean.lerp_(gradient, 1 - beta1)
        square.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
        torch.maximum(largest, square, out=largest)  # amsgrad
        scale = (largest.sqrt() * plan[:, ROOT, None]).add_(self.adam["eps"])
        online.addcdiv_(mean * plan[:, RATE, None], scale, value=-1)
        target.lerp_(online, self.recipe.target_update_rate)

    # Between chunks of steps, the host looks after the runs

    def next_plan(self, steps: int, updates: int, head: int, filled: int) -> np.ndarray:
        """The plan for the next `CHUNK` steps, or up to the end of the bin, the validation or the
        run if that comes first; (steps, R, 5) float32."""
        recipe, N = self.recipe, self.N
        ends = [(steps // every + 1) * every for every in (BIN, recipe.validation_interval)]
        count = min(-(-(min(*ends, recipe.steps) - steps) // N), CHUNK)
        beta1, beta2 = self.adam["betas"]
        plan = np.zeros((max(count, 0), self.R, 5), np.float32)
        for i, row in enumerate(plan):
            random = filled * N < recipe.replay_prefill
            filled = min(filled + 1, self.L - 1)
            learning = filled * N >= recipe.replay_prefill
            updates += learning
            heat = 0.0 if random else 1 / recipe.temperature
            rate = recipe.learning_rate / (1 - beta1**updates) if learning else 0.0
            root = 1 / math.sqrt(1 - beta2**updates) if learning else 0.0
            row[:] = heat, rate, root, (head + i) % self.L, filled
        return plan

    def place(self) -> tuple[int, int, int, int]:
        """Steps, updates, head and filled of the runs, the same in all."""
        first = self.trainers[0]
        return first.steps, first.updates, first.replay.head, first.replay.filled

    def train(self, until: float) -> None:
        """Train until the runs are finished, or until that moment of `time.perf_counter`."""
        plan, began = self.next_plan(*self.place()), time.perf_counter()
        before = self.trainers[0].seconds
        while not self.trainers[0].finished and time.perf_counter() < until:
            count = len(plan)
            self.plan[:count] = torch.from_numpy(plan).to(self.device)
            self.now.zero_()
            for step in plan[:, 0, ROOT]:
                (self.learn if step > 0 else self.fill)()
            steps, updates, head, _ = self.place()
            learned = int((plan[:, 0, ROOT] > 0).sum())
            steps_now, updates_now = steps + count * self.N, updates + learned
            head, filled = (head + count) % self.L, int(plan[-1, 0, FILLED])
            plan = self.next_plan(steps_now, updates_now, head, filled)  # while the device works
            self._renew()
            self._note(count, learned)
            seconds = before + time.perf_counter() - began
            for trainer in self.trainers:
                trainer.steps, trainer.updates, trainer.seconds = steps_now, updates_now, seconds
                trainer.replay.head, trainer.replay.filled = head, filled
            interval = self.recipe.validation_interval
            if steps_now // BIN > steps // BIN:
                self._end_bin()
            if self.trainers[0].finished or steps_now // interval > steps // interval:
                self._validate()

    def _renew(self) -> None:
        """New missions in place of those that were taken before this chunk."""
        missions = self.pool.shape[2]
        count = (self.taken - self.renewed).clip(max=missions)
        run, lane = np.indices(count.shape).reshape(2, -1).repeat(count.ravel(), axis=1)
        if not len(run):
            return
        place = np.concatenate([np.arange(n) for n in count.ravel()])  # 0, 1, … of each lane
        place = (self.renewed[run, lane] + place) % missions
        rows = [starts(trainer, n) for trainer, n in zip(self.trainers, count.sum(1), strict=True)]
        where = torch.from_numpy(np.stack([run, lane, place])).to(self.device)
        self.pool[tuple(where)] = torch.from_numpy(np.concatenate(rows)).to(self.device)
        self.renewed = self.taken

    def _note(self, count: int, learned: int) -> None:
        """Give the trainers what was logged: the ordinary episodes that ended, and the losses."""
        before, self.taken = self.taken, self.cursor.cpu().numpy().copy()
        log, losses = self.log[:count].cpu().numpy(), self.losses[count - learned : count].cpu()
        for r, trainer in enumerate(self.trainers):
            total, landed, collected = log[:, r][log[:, r, :, 0] > 0][:, 1:].T
            rows = np.stack([total, landed, collected, collected * landed], axis=1)
            trainer.episodes += rows.tolist()
            trainer.ended += int((self.taken - before)[r].sum())
            trainer.losses += losses[:, r].tolist()

    def _end_bin(self) -> None:
        """A row of the learning curve, with greedy flights of new missions as in the library."""
        flights = [min(t.ended // PER_FLIGHT, self.greedy.count) for t in self.trainers]
        missions = self.validation_missions[:, : self.greedy.count].copy()
        for r, (trainer, count) in enumerate(zip(self.trainers, flights, strict=True)):
            drawn = trainer.environment, count, trainer.greedy_generator
            missions[r, :count] = packed(trainer.scenario.sample(*drawn))
        records = self.greedy.fly(missions)
        for r, (trainer, count) in enumerate(zip(self.trainers, flights, strict=True)):
            means = {k: float(records[k][r, :count].mean()) if count else None for k in CURVES}
            row = {"greedy_flights": count} | {f"greedy_{k}": v for k, v in means.items()}
            trainer._greedy_flights = lambda row=row: row
            trainer._add_row()
        if any(trainer.is_best for trainer in self.trainers):  # by its test flights
            self.fetch(weights_alone=True)
            for run in self.runs:
                run.write("best" if run.trainer.is_best else None)

    def _validate(self) -> None:
        """Fly the validation's missions, and keep the agents that are better than before."""
        records = self.validation.fly(self.validation_missions)
        self.fetch(weights_alone=True)
        for r, run in enumerate(self.runs):
            rows = run.trainer.validation_rows
            means = {name: float(values[r].mean()) for name, values in records.items()}
            rows.append(run.trainer.progress | means)
            finite = "" if run.trainer.is_finite() else ", NOT FINITE"
            run.write("best" if run.trainer.is_best else None)
            print(
                f"{run.folder.name}: {run.trainer.steps} steps, return {means['return']:.2f}, "
                f"collected and landed {means['collected_and_landed']:.3f}{finite}",
                flush=True,
            )

    def fetch(self, weights_alone: bool = False) -> None:
        """Give the trainers the weights, and all else that they need to go on without the fleet."""
        vectors, memory = self.vectors.cpu(), None if weights_alone else self.memory.cpu().numpy()
        lanes = self.lanes.cpu().numpy()
        for r, trainer in enumerate(self.trainers):
            tensors = {
                f"{of}.{name}": weight
                for of, vector in zip(VECTORS, vectors[:, r], strict=True)
                for name, weight in self.networks.weights(vector).items()
            }
            step = torch.tensor(float(trainer.updates))
            tensors |= {f"step.{name}": step.clone() for name in self.networks.shapes}
            trainer.learner.load_state_dict(tensors)
            if memory is None:
                continue
            trainer.state = unpacked(lanes[r, :, : self.F])
            trainer.returns = lanes[r, :, -1].astype(float)
            replay, rows = trainer.replay, memory[r].reshape(self.L * self.N, -1)
            states = vars(unpacked(rows[:, : self.F]))
            states |= {"action": rows[:, -3], "reward": rows[:, -2], "terminal": rows[:, -1]}
            for name, array in replay.state_dict().items():
                if name in states:
                    array[:] = states[name].reshape(array.shape)


class Flights:
    """Missions that the networks of a fleet fly greedily, G for each run, all at once."""

    def __init__(self, fleet: Fleet, count: int):
        zeros, runs = torch.zeros, fleet.R
        self.fleet, self.count = fleet, count
        self.states = zeros(runs, count, fleet.F, device=fleet.device)
        self.sums = zeros(runs, count, 4, device=fleet.device)  # return, landed, steps, replaced
        self.fading = zeros(runs, count, fleet.world.slots, fleet.K, device=fleet.device)
        self.states[..., 1] = 1
        changed = [self.states, self.sums]
        self.step = Captured(self._step, changed, fleet.generator, fleet.stream)

    @torch.no_grad()
    def _step(self) -> None:
        fleet, states = self.fleet, self.states
        self.fading.normal_(generator=fleet.generator)
        action = fleet.networks(fleet.leaves, *fleet.world.observe(states)).argmax(dim=-1)
        after, what, _ = fleet.world.transition(states, action, self.fading)
        flying = (states[..., 1:2] > 0) & (self.sums[..., 1:2] == 0)
        reward = (what * fleet.usual).sum(-1)
        now = torch.stack([reward, 1 - what[..., 1], torch.ones_like(reward), what[..., 2]], dim=-1)
        self.sums += flying * now
        states.copy_(torch.where(flying, after, states))

    def fly(self, missions: np.ndarray) -> dict[str, np.ndarray]:
        """Fly packed missions, (R, G, F), to their end; the records of `Flights`, (R, G) each."""
        self.states.copy_(torch.from_numpy(missions))
        self.sums.zero_()
        for _ in range(int(missions[..., 1].max())):
            self.step()
        total, landed, steps, replaced = self.sums.cpu().double().numpy().transpose(2, 0, 1)
        initial, left = np.split(self.states.cpu().numpy()[..., 2 + self.fleet.K :], 2, axis=-1)
        collected = (initial - left).sum(-1) / initial.sum(-1)
        return {
            "landed": landed,
            "collected": collected,
            "collected_and_landed": collected * landed,
            "return": total,
            "time_used": steps / missions[..., 1],
            "safety_interventions": replaced,
        }


def starts(trainer: Trainer, count: int) -> np.ndarray:
    """Lanes at the start of new episodes, drawn as the trainer draws them; (count, F + 1)."""
    rows = packed(trainer._draw_starts(count)[0])
    return np.pad(rows, ((0, 0), (0, 1)))


class Run:
    """The files of one run."""

    def __init__(self, folder: Path, trainer: Trainer, how: dict):
        self.folder, self.trainer, self.how = folder, trainer, how
        require_whole(folder, resume=True)
        if (folder / SAVED).exists():
            resume_run(folder, trainer)

    def write(self, agent: str | None = None) -> None:
        """Write the tables and how the run was made, and an agent under this name."""
        trainer, folder = self.trainer, self.folder
        training = trainer.agent.training | self.how
        write_json(folder / "about.json", training | identity(trainer) | self.how)
        tables = {"training": trainer.training_rows, "validation": trainer.validation_rows}
        for name, rows in tables.items():
            if rows:
                write_table(folder / f"{name}.csv", rows)
        if agent:
            save_agent(folder / f"{agent}.safetensors", replace(trainer.agent, training=training))


def fleets_of(runs: list[Run]) -> list[list[Run]]:
    """The runs that can be stacked, together: of equal recipes, and equally far."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        shape = {k: v for k, v in run.trainer.recipe.as_json().items() if k != "name"}
        groups.setdefault(str((shape, run.trainer.steps)), []).append(run)
    return list(groups.values())


def train(fleet: Fleet, until: float) -> None:
    """Train a fleet on its stream until that moment, and write its runs' files."""
    first, begun = fleet.trainers[0], time.perf_counter()
    before = first.steps
    with torch.cuda.stream(fleet.stream):  # without one, nothing
        try:
            fleet.train(until)
        finally:
            seconds = time.perf_counter() - begun
            fleet.fetch()
            for run in fleet.runs:
                run.write("last")
                save_run(run.folder / SAVED, run.trainer)
    rate = (first.steps - before) / fleet.N / seconds
    name = f"{fleet.runs[0].folder.name} and {len(fleet.runs) - 1} more"
    print(f"{name}: {first.steps} steps, {rate:.0f} steps of the fleet a second", flush=True)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("variants", nargs="*", default=["as_it_is"], metavar="VARIANT")
    add("--scenario", default="manhattan")
    add("--seeds", type=int, default=3, help="how many of each variant")
    add("--minutes", type=float, default=60, help="from the start; then the runs are saved")
    add("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    add("--out", type=Path, default=Path("build/fleet"))
    add("--compiled", action="store_true", help="torch.compile joins small kernels")
    options = parser.parse_args(arguments)
    until = time.perf_counter() + 60 * options.minutes
    torch.set_num_threads(1)  # the host has little to compute
    scenario = find_scenario(options.scenario)
    kind = torch.cuda.get_device_name() if options.device.startswith("cuda") else options.device
    command = shlex.join(["python", "benchmarks/fleet.py", *(arguments or sys.argv[1:])])
    how = {"program": "benchmarks/fleet.py", "command": command, "device": kind}
    runs = [
        Run(options.out / f"{name}-{seed}", Trainer(scenario, recipe, seed), how)
        for name, recipe in variants_of(PLAIN, options.variants).items()
        for seed in range(options.seeds)
    ]
    groups = fleets_of([run for run in runs if not run.trainer.finished])
    fleets = [Fleet(group, options.device, options.compiled) for group in groups]
    with ThreadPoolExecutor(max(len(fleets), 1)) as threads:
        jobs = [threads.submit(train, fleet, until) for fleet in fleets]
    failures = [job.exception() for job in jobs if job.exception()]
    for failure in failures:
        traceback.print_exception(failure)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()

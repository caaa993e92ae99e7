"""The training loop: act, step, remember, learn; its whole state is saved and restored."""

import copy
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from uavdh_lite import streams
from uavdh_lite.advantage_learning import action_gap, widen_gap
from uavdh_lite.agent import NETWORK, Agent, build, choices
from uavdh_lite.checkpoint import load, save
from uavdh_lite.city import Cities, City, as_cities
from uavdh_lite.city_generator import load_city
from uavdh_lite.ddqn import DDQN, Networks, draw_actions, only_allowed, softmax_policy
from uavdh_lite.environment import ACTIONS, Environment, Outcome, Rewards, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate
from uavdh_lite.provenance import provenance
from uavdh_lite.quantile import QRDQN
from uavdh_lite.recipe import Recipe
from uavdh_lite.replay import Replay
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream, torch_seed
from uavdh_lite.symmetry import turned_cities

BIN = 5000  # environment steps a row of training.csv, as in the paper's figure
VALIDATION_SEED = 0


class EpisodeStatistics:
    """The means of a row of training.csv: over the episodes that ended since the row before.

    Only episodes with an ordinary start count, so that the figures compare with an evaluation.

    | attribute | shape | meaning |
    | --- | --- | --- |
    | `ordinary` | (N,) bool | whether the episode in each environment had an ordinary start |
    | `reward` | (N,) | its reward so far, in the paper's constants |
    | `sums` | (4,) | reward, landed, collection ratio, collection ratio and landed |
    | `counts` | (2,) | episodes, updates |
    | `loss` | () | sum over the updates |
    """

    METRICS = ("cumulative_reward", "has_landed", "collection_ratio", "collection_ratio_and_landed")

    def __init__(self, environments: int, device: torch.device):
        self.ordinary = np.ones(environments, bool)
        self.reward = np.zeros(environments)
        self.sums = np.zeros(4)
        self.counts = np.zeros(2, int)
        self.loss = torch.zeros((), device=device)

    def begin(self, environments: np.ndarray, ordinary: np.ndarray) -> None:
        """New episodes start in these environments."""
        self.ordinary[environments] = ordinary
        self.reward[environments] = 0

    def end(self, environments: np.ndarray, state: State) -> None:
        """The episodes in these environments ended in these states."""
        counted = self.ordinary[environments]
        state, reward = state[counted], self.reward[environments][counted]
        ratio = state.collection_ratio
        means = (reward, state.landed, ratio, ratio * state.landed)
        self.sums += [values.sum() for values in means]
        self.counts[0] += len(state)

    def learned(self, loss: Tensor) -> None:
        """An update was made."""
        self.loss += loss
        self.counts[1] += 1

    def row(self) -> dict:
        """The row's columns, None where there is nothing to average; starts a new row."""
        episodes, updates = (int(count) for count in self.counts)
        means = self.sums / max(episodes, 1)
        row = {
            "episodes": episodes,
            **{
                name: float(mean) if episodes else None
                for name, mean in zip(self.METRICS, means, strict=True)
            },
            "loss": float(self.loss) / updates if updates else None,
        }
        self.sums[:], self.counts[:] = 0, 0
        self.loss.zero_()
        return row

    def state_dict(self) -> dict[str, Tensor]:
        """All of it, by name."""
        arrays = {name: vars(self)[name] for name in ("ordinary", "reward", "sums", "counts")}
        return {"loss": self.loss, **{name: torch.tensor(array) for name, array in arrays.items()}}

    def load_state_dict(self, tensors: dict[str, Tensor]) -> None:
        """Restore what `state_dict` gave."""
        self.loss.copy_(tensors["loss"])
        for name in ("ordinary", "reward", "sums", "counts"):
            vars(self)[name][:] = tensors[name].numpy()


class Minibatch(NamedTuple):
    """What an update learns from: B states, the actions taken in them, and the targets.

    The targets are (B,), or (B, N) with N quantiles.
    """

    state: State
    action: Tensor
    y: Tensor
    observation: tuple[list[Tensor], Tensor]


class Trainer:
    """One training run, step by step; `experiments.runs.train` runs it with files and progress.

    The same scenario, city, recipe, seed and device give the same weights on one machine. Call
    `close` to end its second thread, if it has one.

    Arguments:
        city: the city to fly over, or several, one for each episode; the scenario's own if None.
        device: `cpu`, `cuda` or `mps`.
        begin_with: the agent whose weights the run begins with, to fine-tune it; None for random
            ones.

    Raises `InputError` if that agent's network or observation is not that of the recipe.
    """

    threads = 1

    def __init__(
        self,
        scenario: Scenario,
        recipe: Recipe,
        seed: int,
        city: City | Cities | None = None,
        device: str = "cpu",
        begin_with: Agent | None = None,
    ):
        self.scenario, self.recipe, self.seed = scenario, recipe, seed
        self.city = city if city is not None else load_city(scenario.city)
        self.device = torch.device(device)
        self.learned_in = turned_cities(self.city) if recipe.turned else self.city
        self.environment = Environment(self.learned_in, failsafe=recipe.failsafe)
        self.generator = stream(Use.TRAINING, seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(torch_seed(Use.WEIGHTS, seed))
            size = 0 if begin_with is None else begin_with.observation.size
            self.observation, network = build(recipe, self.learned_in, size)
        if begin_with is not None:
            _require_same_network(recipe, begin_with.recipe)
            network.load_state_dict(begin_with.network.state_dict())
        of_many_cities = len(self.environment.cities) > 1  # all directions are alike in them
        self.symmetric = of_many_cities or (begin_with is not None and begin_with.symmetric)
        self.observation.to(self.device)
        network.to(self.device)
        optimiser = torch.optim.Adam(
            network.parameters(), recipe.learning_rate, amsgrad=recipe.amsgrad, fused=True
        )
        method = QRDQN if recipe.quantiles else DDQN
        self.learner = method(network, optimiser, recipe.target_update_rate, recipe.huber_delta)
        self.networks: Networks = self.learner  # those that act and give the targets
        self.replay = Replay(
            recipe.replay_capacity,
            recipe.environments,
            scenario.max_devices,
            self.environment.cities.cell_type,
        )
        self.statistics = EpisodeStatistics(recipe.environments, self.device)
        self.steps = self.updates = 0
        self.seconds = 0.0  # spent training, resumed parts included
        self.training_rows: list[dict] = []
        self.validation_rows: list[dict] = []
        self.state = self._starts(np.arange(recipe.environments))
        self.minibatch: Minibatch | None = None  # for the next update

    def step(self) -> None:
        """One step of all environments and, once the replay memory is prefilled, one update.

        The update takes the minibatch that the step before has drawn. So it does not wait for this
        step's flight, and the flight does not wait for it: see `OverlappedTrainer`.
        """
        state, recipe = self.state, self.recipe
        action = self._act(state)
        next_state, outcome = self.environment.step(state, action, self.generator)
        reward = recipe.rewards_at(self.steps)(outcome)
        self.replay.add(state, action, reward, next_state.ended, next_state)
        self.state = self._replace_ended(next_state, outcome)
        minibatch, self.minibatch = self.minibatch, self._draw_minibatch()
        if minibatch is not None:
            self._learn(minibatch)
        self.steps += recipe.environments
        if self.steps // BIN > (self.steps - recipe.environments) // BIN:
            self._add_row()

    def _act(self, state: State) -> np.ndarray:
        """Actions of the softmax policy; uniform ones until the replay memory is prefilled."""
        allowed = self._allowed(state)
        if len(self.replay) < self.recipe.replay_prefill:
            if allowed is None:
                return self.generator.integers(0, len(ACTIONS), len(state))
            return draw_actions(allowed / allowed.sum(dim=1, keepdim=True), self.generator)
        with torch.no_grad():
            q_values = self.networks.online(*self.observation(state))
        temperature = self.recipe.temperature_at(self.steps)
        probabilities = softmax_policy(only_allowed(q_values, allowed), temperature)
        return draw_actions(probabilities, self.generator)

    def _allowed(self, state: State) -> Tensor | None:
        allowed = choices(self.environment, state)
        return None if allowed is None else allowed.to(self.device)

    def _draw_minibatch(self) -> Minibatch | None:
        """A minibatch from the memory with its targets; None until the memory is prefilled."""
        recipe = self.recipe
        if len(self.replay) < recipe.replay_prefill:
            return None
        batch = self.replay.sample(
            recipe.batch_size, self.generator, recipe.discount, recipe.return_steps
        )
        action, reward, discount = (
            torch.from_numpy(array).to(self.device)
            for array in (batch.action, batch.reward, batch.discount)
        )
        y = self.networks.targets(
            reward, discount, self.observation(batch.next_state), self._allowed(batch.next_state)
        )
        observation = self.observation(batch.state)
        if recipe.advantage_learning:
            with torch.no_grad():
                q_values = self.networks.target(*observation)
            gap = action_gap(q_values, action, self._allowed(batch.state))
            y = widen_gap(y, gap, recipe.advantage_learning)
        return Minibatch(batch.state, action, y, observation)

    def _learn(self, minibatch: Minibatch) -> None:
        self.learner.set_learning_rate(self.recipe.learning_rate_at(self.steps))
        loss = self.learner.update(minibatch.observation, minibatch.action, minibatch.y)
        self.statistics.learned(loss)
        self.updates += 1

    def _replace_ended(self, state: State, outcome: Outcome) -> State:
        """Count the step and the episodes that ended, and start new ones in their place."""
        self.statistics.reward += Rewards()(outcome)
        ended = np.flatnonzero(state.ended)
        if not len(ended):
            return state
        self.statistics.end(ended, state[ended])
        return state.with_rows(ended, self._starts(ended))

    def _starts(self, environments: np.ndarray) -> State:
        """New episodes for these environments, a share of them exploring starts."""
        recipe, count = self.recipe, len(environments)
        state = self.scenario.sample(self.learned_in, count, self.generator)
        exploring = self.generator.random(count) < recipe.exploring_starts
        if exploring.any():
            state = state.with_rows(
                exploring,
                self.scenario.sample_anywhere(
                    self.learned_in, exploring.sum(), self.generator, recipe.exploring_spare_time
                ),
            )
        self.statistics.begin(environments, ~exploring)
        return state

    def _add_row(self) -> None:
        self.training_rows.append(
            {
                "steps": self.steps,
                "updates": self.updates,
                "seconds": round(self.seconds, 1),
                **self.statistics.row(),
                "temperature": self.recipe.temperature_at(self.steps),
                "learning_rate": self.recipe.learning_rate_at(self.steps),
            }
        )

    @property
    def agent(self) -> Agent:
        """The agent as it is now; it shares the weights with the run.

        It flies by one view of the map, which is eight times as fast as by all symmetries.
        """
        return self._agent().over(self.city)

    def _agent(self) -> Agent:
        """The agent over all that it learns in."""
        training = {
            "seed": self.seed,
            "cities": len(as_cities(self.city)),
            "symmetric": self.symmetric,
            "steps": self.steps,
            "updates": self.updates,
            "seconds": round(self.seconds, 1),
            "device": str(self.device),
            **provenance(),
            "threads": self.threads,
            "validation": self.validation_rows[-1] if self.validation_rows else None,
        }
        parts = (self.learner.online, self.observation, self.recipe, self.scenario)
        return Agent(*parts, self.learned_in, training)

    @property
    def finished(self) -> bool:
        return self.steps >= self.recipe.steps

    def is_finite(self) -> bool:
        """Whether the loss and all weights are still finite."""
        parts = [self.statistics.loss, *self.learner.online.parameters()]
        return all(bool(torch.isfinite(part).all()) for part in parts)

    def close(self) -> None:
        """End the run's thread, if it has one."""

    def validate(self) -> bool:
        """Fly the validation scenarios greedily; whether the agent has its highest return so far.

        The return has the paper's constants: data collected, less a price for time and crashes.
        """
        episodes = self.recipe.validation_episodes
        flights = evaluate(
            self.environment,
            self._agent(),
            self.scenario,
            episodes,
            VALIDATION_SEED,
            Use.VALIDATION,
        )
        means = {name: float(values.mean()) for name, values in flights.records().items()}
        best = max((row["cumulative_reward"] for row in self.validation_rows), default=-np.inf)
        counts = {"steps": self.steps, "updates": self.updates, "seconds": round(self.seconds, 1)}
        self.validation_rows.append(counts | means)
        return means["cumulative_reward"] > best

    def save(self, path: Path) -> None:
        """Write everything the run needs to go on as if it had never stopped."""
        parts: dict[str, DDQN | Replay | EpisodeStatistics]
        parts = {"ddqn": self.learner, "replay": self.replay, "statistics": self.statistics}
        tensors = {
            f"{part}.{name}": torch.as_tensor(value)
            for part, whole in parts.items()
            for name, value in whole.state_dict().items()
        }
        tensors |= _tensors("state.", self.state)
        if self.minibatch is not None:
            tensors |= _tensors("minibatch.state.", self.minibatch.state)
            tensors |= {"minibatch.action": self.minibatch.action, "minibatch.y": self.minibatch.y}
        about = self.identity() | {
            "generator": self.generator.bit_generator.state,
            "steps": self.steps,
            "updates": self.updates,
            "seconds": self.seconds,
            "training_rows": self.training_rows,
            "validation_rows": self.validation_rows,
        }
        save(path, "training", tensors, about)

    def restore(self, path: Path) -> None:
        """Go on from what `save` wrote; `InputError` if that is another run."""
        tensors, about = load(path, "training")
        for name, value in self.identity().items():
            if about.get(name) != value:
                difference = _difference(about.get(name), value)
                raise InputError(f"{path}: another {name} than asked for{difference}")
        self.learner.load_state_dict(_under("ddqn.", tensors))
        replay = {name: tensor.numpy() for name, tensor in _under("replay.", tensors).items()}
        self.replay.load_state_dict(replay)
        self.statistics.load_state_dict(_under("statistics.", tensors))
        self.state = _state("state.", tensors)
        if "minibatch.y" in tensors:
            action, y = (tensors[f"minibatch.{name}"].to(self.device) for name in ("action", "y"))
            state = _state("minibatch.state.", tensors)
            self.minibatch = Minibatch(state, action, y, self.observation(state))
        self.generator.bit_generator.state = about["generator"]
        self.steps, self.updates = about["steps"], about["updates"]
        self.seconds = about["seconds"]
        self.training_rows, self.validation_rows = about["training_rows"], about["validation_rows"]

    def identity(self) -> dict:
        """What defines the run: recipe, scenario, city, seed and streams, as JSON values.

        A saved run can only go on as this one if all of it is equal.
        """
        values = {
            "recipe": self.recipe.as_json(),
            "scenario": asdict(self.scenario),
            "city": self.city.fingerprint,
            "seed": self.seed,
            "streams": streams.VERSION,
        }
        return json.loads(json.dumps(values))  # tuples become lists, as in a file


class OverlappedTrainer(Trainer):
    """A `Trainer` whose updates run on a second thread while the first one flies.

    The results are the same. In a `Trainer`, acting and the targets come before the update; here
    they use a copy of the networks from before it.
    """

    threads = 2

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        self.networks = copy.deepcopy(self.learner)
        self._pool: ThreadPoolExecutor | None = None

    def step(self) -> None:
        self.networks.copy_from(self.learner)
        if self.minibatch is not None:
            self._update = self._other_thread.submit(super()._learn, self.minibatch)
        super().step()

    def _learn(self, minibatch: Minibatch) -> None:
        self._update.result()  # it began with the step

    @property
    def _other_thread(self) -> ThreadPoolExecutor:
        if self._pool is None:
            # torch keeps the number of its threads for each thread; sums depend on it
            same = (torch.get_num_threads(),)
            self._pool = ThreadPoolExecutor(1, "update", torch.set_num_threads, same)
        return self._pool

    def close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None


def _require_same_network(recipe: Recipe, other: Recipe) -> None:
    """Raise `InputError` if the weights of one recipe do not fit the other."""
    difference = [
        f"{name} is {getattr(other, name)} there, {getattr(recipe, name)} here"
        for name in NETWORK
        if getattr(recipe, name) != getattr(other, name)
    ]
    if difference:
        raise InputError(
            f"recipe {recipe.name} has another network than the agent to begin with: "
            + "; ".join(difference)
        )


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


def _tensors(prefix: str, state: State) -> dict[str, Tensor]:
    return {prefix + f.name: torch.tensor(getattr(state, f.name)) for f in fields(State)}


def _state(prefix: str, tensors: dict[str, Tensor]) -> State:
    return State(**{name: value.numpy() for name, value in _under(prefix, tensors).items()})


def _difference(saved, asked) -> str:
    """The fields in which two JSON values differ, for an error."""
    if not isinstance(saved, dict):
        return f": {saved} there, {asked} here"
    names = [k for k in sorted(saved.keys() | asked.keys()) if saved.get(k) != asked.get(k)]
    return "; " + ", ".join(f"{k}: {saved.get(k)} there, {asked.get(k)} here" for k in names)

"""The training loop: collect, learn, validate; saved and restored whole."""

import copy
import json
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from uavdh_lite.agent import Agent, build
from uavdh_lite.checkpoint import load, save
from uavdh_lite.city import City
from uavdh_lite.ddqn import DDQN, Networks, draw_actions, softmax_policy
from uavdh_lite.environment import ACTIONS, Environment, Rewards, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import TRAINING, VALIDATION, evaluate, stream
from uavdh_lite.recipe import Recipe
from uavdh_lite.replay import Replay
from uavdh_lite.scenario import Scenario
from uavdh_lite.tables import provenance

BIN = 5000  # environment steps a row of training.csv, as in the paper's figure
VALIDATION_SEED = 0


@dataclass(frozen=True)
class Minibatch:
    """What an update learns from: B states, what the network sees of them, the action taken in
    each, (B,), and its target y."""

    state: State
    observation: tuple[list[Tensor], Tensor]
    action: Tensor
    y: Tensor


class Trainer:
    """One training run, step by step; `runs.train` runs it with files and progress.

    It is deterministic: the same scenario, city, recipe, seed and device give the same weights on
    one machine.

    Arguments:
        city: the city to fly over; the scenario's own if None.
        device: `cpu` or `cuda`.
        threads: 1, or 2 to fly beside the updates; the weights are the same.

    Raises `InputError` for another number of threads.
    """

    def __init__(
        self,
        scenario: Scenario,
        recipe: Recipe,
        seed: int,
        city: City | None = None,
        device: str = "cpu",
        threads: int = 1,
    ):
        if threads not in (1, 2):
            raise InputError(f"threads is {threads}: a training run takes 1 or 2")
        self.scenario, self.recipe, self.seed = scenario, recipe, seed
        self.city = city if city is not None else City.load(scenario.city)
        self.device, self.threads = torch.device(device), threads
        self.environment = Environment(self.city)
        self.generator = stream(TRAINING, seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.observation, network = build(recipe, self.city)
        self.observation.to(self.device)
        network.to(self.device)
        optimiser = torch.optim.Adam(
            network.parameters(), recipe.learning_rate, amsgrad=recipe.amsgrad, fused=True
        )
        self.ddqn = DDQN(network, optimiser, recipe.target_update_rate, recipe.huber_delta)
        self._before = Networks(copy.deepcopy(network))  # as they were before the update at work
        self._helper: Executor = ThreadPoolExecutor(1) if threads == 2 else _AtOnce()
        self.replay = Replay(recipe.replay_capacity, recipe.environments, scenario.max_devices)
        self.steps = self.updates = 0
        self.seconds = 0.0  # spent training, resumed parts included
        self.training_rows: list[dict] = []
        self.validation_rows: list[dict] = []
        # Of the episodes in the air: whether it had an ordinary start, its reward so far
        self.ordinary = np.ones(recipe.environments, bool)
        self.episode_reward = np.zeros(recipe.environments)
        self.minibatch: Minibatch | None = None  # for the next update
        self._empty_bin()
        self.state = self._starts(np.arange(recipe.environments))

    def _empty_bin(self) -> None:
        self.bin_episodes = np.zeros(4)  # number; sums of reward, landed, collection ratio
        self.bin_cral = 0.0
        self.bin_loss = torch.zeros((), device=self.device)
        self.bin_updates = 0

    @property
    def agent(self) -> Agent:
        """The agent as it is now; it shares the weights with the run."""
        training = {
            "seed": self.seed,
            "steps": self.steps,
            "updates": self.updates,
            "seconds": round(self.seconds, 1),
            "device": str(self.device),
            **provenance(),
            "threads": self.threads,
            "validation": self.validation_rows[-1] if self.validation_rows else None,
        }
        parts = (self.ddqn.online, self.observation, self.recipe, self.scenario, self.city)
        return Agent(*parts, training)

    @property
    def finished(self) -> bool:
        return self.steps >= self.recipe.steps

    def is_finite(self) -> bool:
        """Whether the loss and all weights are numbers still."""
        parts = [self.bin_loss, *self.ddqn.online.parameters()]
        return all(bool(torch.isfinite(part).all()) for part in parts)

    def step(self) -> None:
        """One step of all environments and, once the replay memory is prefilled, one update.

        The update takes the minibatch that the step before prepared. So flying, sampling and the
        targets need nothing of it, and a second thread can do them meanwhile. They use the weights
        from before the update, also when there is one thread: the results are the same.
        """
        learning_rate, minibatch = self.recipe.learning_rate_at(self.steps), self.minibatch
        self._before.copy_from(self.ddqn)
        ahead = self._helper.submit(self._fly_and_prepare)
        if minibatch is not None:
            self._learn(minibatch, learning_rate)
        self.minibatch = ahead.result()
        if self.steps // BIN > (self.steps - self.recipe.environments) // BIN:
            self._close_bin()

    def _fly_and_prepare(self) -> Minibatch | None:
        """One step of all environments; then a minibatch, if the replay memory is prefilled."""
        recipe, state = self.recipe, self.state
        action = self._explore(state)
        fading = self.environment.draw_fading(state, self.generator)
        after, outcome = self.environment.transition(state, action, fading)
        self.replay.add(state, action, recipe.rewards_at(self.steps)(outcome), after.ended, after)
        self.episode_reward += Rewards()(outcome)
        ended = np.flatnonzero(after.ended)
        if len(ended):
            self._account(after[ended], ended)
            after = after.with_rows(ended, self._starts(ended))
        self.state = after
        self.steps += recipe.environments
        return self._prepare() if len(self.replay) >= recipe.replay_prefill else None

    def _explore(self, state: State) -> np.ndarray:
        """Actions of the softmax policy; uniform ones until the replay memory is prefilled."""
        if len(self.replay) < self.recipe.replay_prefill:
            return self.generator.integers(0, len(ACTIONS), len(state))
        with torch.no_grad():
            q_values = self._before.online(*self.observation(state))
        probabilities = softmax_policy(q_values, self.recipe.temperature_at(self.steps))
        return draw_actions(probabilities, self.generator)

    def _prepare(self) -> Minibatch:
        recipe = self.recipe
        batch = self.replay.sample(
            recipe.batch_size, self.generator, recipe.discount, recipe.return_steps
        )
        action, reward, discount = (
            torch.from_numpy(array).to(self.device)
            for array in (batch.action, batch.reward, batch.discount)
        )
        y = self._before.targets(reward, discount, self.observation(batch.next_state))
        return Minibatch(batch.state, self.observation(batch.state), action, y)

    def _learn(self, minibatch: Minibatch, learning_rate: float) -> None:
        for group in self.ddqn.optimiser.param_groups:
            group["lr"] = learning_rate
        self.bin_loss += self.ddqn.descend(minibatch.observation, minibatch.action, minibatch.y)
        self.bin_updates += 1
        self.updates += 1

    def _starts(self, places: np.ndarray) -> State:
        """New episodes for these environments, a share of them exploring starts."""
        recipe, count = self.recipe, len(places)
        state = self.scenario.sample(self.city, count, self.generator)
        exploring = self.generator.random(count) < recipe.exploring_starts
        if exploring.any():
            state = state.with_rows(
                exploring,
                self.scenario.sample_anywhere(
                    self.city, exploring.sum(), self.generator, recipe.exploring_spare_time
                ),
            )
        self.ordinary[places] = ~exploring
        self.episode_reward[places] = 0
        return state

    def _account(self, end: State, places: np.ndarray) -> None:
        """Add ended episodes to the bin; only ordinary ones, so that the figures compare."""
        own = self.ordinary[places]
        end, reward = end[own], self.episode_reward[places][own]
        ratio = end.collection_ratio
        self.bin_episodes += (len(end), reward.sum(), end.landed.sum(), ratio.sum())
        self.bin_cral += float((ratio * end.landed).sum())

    def _close_bin(self) -> None:
        number, reward, landed, ratio = self.bin_episodes
        each = max(number, 1)
        self.training_rows.append(
            {
                "steps": self.steps,
                "updates": self.updates,
                "seconds": round(self.seconds, 1),
                "episodes": int(number),
                "cumulative_reward": reward / each if number else None,
                "has_landed": landed / each if number else None,
                "collection_ratio": ratio / each if number else None,
                "collection_ratio_and_landed": self.bin_cral / each if number else None,
                "loss": float(self.bin_loss) / self.bin_updates if self.bin_updates else None,
                "temperature": self.recipe.temperature_at(self.steps),
                "learning_rate": self.recipe.learning_rate_at(self.steps),
            }
        )
        self._empty_bin()

    def validate(self) -> bool:
        """Fly the validation scenarios greedily; whether this is the best agent so far."""
        episodes = self.recipe.validation_episodes
        flights = evaluate(
            self.environment, self.agent, self.scenario, episodes, VALIDATION_SEED, VALIDATION
        )
        means = {name: float(values.mean()) for name, values in flights.records().items()}
        best = max((row["collection_ratio_and_landed"] for row in self.validation_rows), default=-1)
        counts = {"steps": self.steps, "updates": self.updates, "seconds": round(self.seconds, 1)}
        self.validation_rows.append(counts | means)
        return means["collection_ratio_and_landed"] > best

    def save(self, path: Path) -> None:
        """Write all that the run needs to go on as if it had never stopped."""
        tensors = {
            "ordinary": torch.from_numpy(self.ordinary),
            "episode_reward": torch.from_numpy(self.episode_reward),
            "bin_episodes": torch.from_numpy(self.bin_episodes),
            "bin_loss": self.bin_loss,
        }
        for part in ("online", "target"):
            network = getattr(self.ddqn, part)
            tensors |= {f"{part}.{name}": value for name, value in network.state_dict().items()}
        for index, moments in self.ddqn.optimiser.state_dict()["state"].items():
            tensors |= {f"optimiser.{index}.{name}": value for name, value in moments.items()}
        for name, array in self.replay.arrays().items():
            tensors[f"replay.{name}"] = torch.from_numpy(array)
        tensors |= _tensors("state.", self.state)
        if self.minibatch is not None:
            tensors |= _tensors("minibatch.state.", self.minibatch.state)
            tensors |= {"minibatch.action": self.minibatch.action, "minibatch.y": self.minibatch.y}
        about = self.identity() | {
            "generator": self.generator.bit_generator.state,
            "replay": [self.replay.head, self.replay.filled],
            "counters": {name: getattr(self, name) for name in self._COUNTERS},
        }
        save(path, "training", tensors, about)

    _COUNTERS = (
        "steps",
        "updates",
        "seconds",
        "bin_cral",
        "bin_updates",
        "training_rows",
        "validation_rows",
    )

    def identity(self) -> dict:
        """What makes the run: recipe, scenario, city and seed, as JSON values.

        All of it must be equal for a saved run to go on as this one.
        """
        values = {
            "recipe": self.recipe.as_json(),
            "scenario": asdict(self.scenario),
            "city": self.city.fingerprint,
            "seed": self.seed,
        }
        return json.loads(json.dumps(values))  # tuples become lists, as in a file

    def restore(self, path: Path) -> None:
        """Go on from what `save` wrote; `InputError` if it is of another run."""
        tensors, about = load(path, "training")
        for name, value in self.identity().items():
            if about.get(name) != value:
                difference = _difference(about.get(name), value)
                raise InputError(f"{path}: another {name} than asked for{difference}")
        for name in ("ordinary", "episode_reward", "bin_episodes"):
            setattr(self, name, tensors[name].numpy())
        self.bin_loss = tensors["bin_loss"].to(self.device)
        for part in ("online", "target"):
            getattr(self.ddqn, part).load_state_dict(_under(f"{part}.", tensors))
        moments: dict[int, dict[str, Tensor]] = {}
        for key, value in _under("optimiser.", tensors).items():
            index, name = key.split(".")
            moments.setdefault(int(index), {})[name] = value
        groups = self.ddqn.optimiser.state_dict()["param_groups"]
        self.ddqn.optimiser.load_state_dict({"state": moments, "param_groups": groups})
        for name, array in self.replay.arrays().items():
            array[:] = tensors[f"replay.{name}"].numpy()
        self.state = _state("state.", tensors)
        if "minibatch.y" in tensors:
            action, y = (tensors[f"minibatch.{name}"].to(self.device) for name in ("action", "y"))
            state = _state("minibatch.state.", tensors)
            self.minibatch = Minibatch(state, self.observation(state), action, y)
        self.generator.bit_generator.state = about["generator"]
        self.replay.head, self.replay.filled = about["replay"]
        for name, value in about["counters"].items():
            setattr(self, name, value)


class _AtOnce(Executor):
    """An executor that does the work at once, in the calling thread."""

    def submit(self, function, /, *arguments, **options) -> Future:
        done: Future = Future()
        done.set_result(function(*arguments, **options))
        return done


def _under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


def _tensors(prefix: str, state: State) -> dict[str, Tensor]:
    return {prefix + f.name: torch.from_numpy(getattr(state, f.name)) for f in fields(State)}


def _state(prefix: str, tensors: dict[str, Tensor]) -> State:
    return State(**{name: value.numpy() for name, value in _under(prefix, tensors).items()})


def _difference(saved, asked) -> str:
    """The fields in which two JSON values differ, for an error."""
    if not isinstance(saved, dict):
        return f": {saved} there, {asked} here"
    names = [k for k in sorted(saved.keys() | asked.keys()) if saved.get(k) != asked.get(k)]
    return "; " + ", ".join(f"{k}: {saved.get(k)} there, {asked.get(k)} here" for k in names)

"""The training loop: act, step, remember, learn; its whole state is saved and restored."""

import json
import time
from dataclasses import asdict
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import torch

from uavdh_lite.agent import Agent
from uavdh_lite.checkpoint import load, save
from uavdh_lite.city import City, described, fingerprint_of, load_cities
from uavdh_lite.config import shown
from uavdh_lite.ddqn import draw_actions, softmax_policy
from uavdh_lite.environment import REPORTED, State
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import evaluate, fly
from uavdh_lite.provenance import provenance
from uavdh_lite.recipe import Recipe
from uavdh_lite.replay import Replay
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream, torch_seed

CURVES = ("return", "landed", "collected", "collected_and_landed")  # in a row of training.csv
BIN = 5000  # environment steps a row of training.csv, as in the paper's figure
EPISODES_PER_GREEDY_FLIGHT = 10  # as in the paper (section IV)
VALIDATION_SEED = 0


class Trainer:
    """One training run, step by step; `experiments.runs.train` runs it with files and progress.

    The same scenario, cities, recipe, seed, device and number of torch's threads give the same
    weights on one machine.

    The curves have the episodes that began as missions do: at a landing zone, with all the data to
    collect. The others, exploring starts, compare with no evaluation.

    Arguments:
        city: the city or cities to fly over; the scenario's own if None.
        device: `cpu`, `cuda` or `mps`.

    Raises `InputError` for anything but a scenario, a recipe, a seed and cities.
    """

    # The attributes that `save` writes as JSON; a subclass adds its own
    PROGRESS: tuple[str, ...] = (
        "steps",
        "updates",
        "seconds",
        "training_rows",
        "validation_rows",
        "episodes",
        "ended",
        "losses",
    )

    def __init__(
        self,
        scenario: Scenario,
        recipe: Recipe,
        seed: int,
        city: City | tuple[City, ...] | None = None,
        device: str = "cpu",
    ):
        for name, given, kind in (("scenario", scenario, Scenario), ("recipe", recipe, Recipe)):
            if not isinstance(given, kind):
                raise InputError(
                    f"a training's {name} is a {kind.__name__}, here is {shown(given)}: "
                    f"find_{name} gives that of a name"
                )
        self.scenario, self.recipe, self.seed = scenario, recipe, seed
        self.environment = recipe.environment_for(
            load_cities(scenario.city) if city is None else city
        )
        self.generator = stream(Use.TRAINING, seed)
        self.greedy_generator = stream(Use.GREEDY_FLIGHTS, seed)
        self.device = device
        observation = recipe.observation_for(self.environment).to(device)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(torch_seed(Use.WEIGHTS, seed))
            network = recipe.network_for(observation)
        self.learner = recipe.learner_for(observation, network.to(device))
        self.replay = Replay(
            recipe.replay_capacity,
            recipe.environments,
            scenario.max_devices,
            recipe.discount,
            recipe.return_steps,
        )
        self.steps = self.updates = 0
        self.seconds = 0.0  # spent training, resumed parts included
        self.training_rows: list[dict] = []
        self.validation_rows: list[dict] = []
        # Since the last row: `CURVES` of the episodes from a start, how many ended at all, losses
        self.episodes: list[list[float]] = []
        self.ended = 0
        self.losses: list[float] = []
        self.from_start = np.ones(recipe.environments, bool)  # whether the episode in flight is one
        self.returns = np.zeros(recipe.environments)  # so far, with the reported rewards
        self.state = self._starts(np.arange(recipe.environments))

    def advance(self) -> bool:
        """A step and, where one is due, a validation; whether there was one."""
        started, before = time.perf_counter(), self.steps
        self.step()
        interval = self.recipe.validation_interval
        due = self.finished or self.steps // interval > before // interval
        if due:
            self.validate()
        self.seconds += time.perf_counter() - started
        return due

    def step(self) -> None:
        """A step of every episode in flight, B in all, and an update once the memory is prefilled.

        Each of the B = `recipe.environments` steps counts as an environment step.
        """
        recipe, state = self.recipe, self.state
        action = self._act(state)
        next_state, outcome = self.environment.step(state, action, self.generator)
        training_reward = recipe.training_rewards_at(self.steps)(outcome)
        self.replay.add(state, action, training_reward, next_state)
        self.returns += REPORTED(outcome)
        self.state = self._restart_ended(next_state)
        if len(self.replay) >= recipe.replay_prefill:
            self.learner.set_learning_rate(recipe.learning_rate_at(self.steps))
            batch = self.replay.sample(recipe.batch_size, self.generator)
            self.losses.append(float(self.learner.update(batch)))
            self.updates += 1
        self.steps += recipe.environments
        if self.steps // BIN > (self.steps - recipe.environments) // BIN:
            self._add_row()

    def _act(self, state: State) -> np.ndarray:
        """Actions of the softmax policy (eq. 10), random ones until the memory is prefilled."""
        if len(self.replay) < self.recipe.replay_prefill:
            return self.environment.random_actions(state, self.generator)
        q_values, temperature = self.learner.q_values(state), self.recipe.temperature_at(self.steps)
        return draw_actions(softmax_policy(q_values, temperature), self.generator)

    def _restart_ended(self, state: State) -> State:
        """Note how those from a start went that ended, and begin new ones in place of all."""
        ended = np.flatnonzero(state.ended)
        landed, collected = state.landed.astype(float), state.collected.astype(float)
        metrics = np.stack([self.returns, landed, collected, collected * landed], axis=1)
        self.episodes += metrics[ended[self.from_start[ended]]].tolist()
        self.ended += len(ended)
        return state.with_rows(ended, self._starts(ended)) if len(ended) else state

    def _starts(self, environments: np.ndarray) -> State:
        """New episodes for these environments, a share of them exploring starts."""
        recipe, count = self.recipe, len(environments)
        state = self.scenario.sample(self.environment, count, self.generator)
        exploring = self.generator.random(count) < recipe.exploring_starts
        if exploring.any():
            under_way = self.scenario.sample_anywhere(
                self.environment, exploring.sum(), self.generator, recipe.exploring_spare_time
            )
            state = state.with_rows(exploring, under_way)
        self.from_start[environments], self.returns[environments] = ~exploring, 0
        return state

    def _add_row(self) -> None:
        """A row of the learning curve: means since the row before, None where there are none.

        Its greedy flights are over new random missions, one for ten episodes that ended.
        """
        means = np.mean(self.episodes, axis=0).tolist() if self.episodes else [None] * len(CURVES)
        row = self.done | {"episodes": len(self.episodes)} | dict(zip(CURVES, means, strict=True))
        row["loss"] = float(np.mean(self.losses)) if self.losses else None
        row["temperature"] = self.recipe.temperature_at(self.steps)
        row["learning_rate"] = self.recipe.learning_rate_at(self.steps)
        self.training_rows.append(row | self._greedy_flights())
        self.episodes, self.ended, self.losses = [], 0, []

    def _greedy_flights(self) -> dict:
        """How the agent as it is now flies greedily."""
        flights = self.ended // EPISODES_PER_GREEDY_FLIGHT
        records: dict = {}
        if flights:
            start = self.scenario.sample(self.environment, flights, self.greedy_generator)
            records = fly(self.environment, self.agent, start, self.greedy_generator).records()
        means = {f"greedy_{k}": float(records[k].mean()) if flights else None for k in CURVES}
        return {"greedy_flights": flights} | means

    def validate(self) -> None:
        """Fly the validation missions greedily: a row of their means.

        They are the same for every run of a scenario. The agent with the highest return in them is
        the one to keep; see `is_best`.
        """
        flights = evaluate(
            self.environment,
            self.agent,
            self.scenario,
            self.recipe.validation_episodes,
            VALIDATION_SEED,
            Use.VALIDATION,
        )
        records = flights.records()
        means = {name: float(values.mean()) for name, values in records.items()}
        self.validation_rows.append(self.done | means)

    @property
    def is_best(self) -> bool:
        """Whether the last validation has the highest return so far."""
        *before, last = (row["return"] for row in self.validation_rows)
        return last > max(before, default=-np.inf)

    @property
    def done(self) -> dict:
        """Environment steps, updates and seconds so far, for the rows of tables."""
        return {"steps": self.steps, "updates": self.updates, "seconds": round(self.seconds, 1)}

    @property
    def agent(self) -> Agent:
        """The agent as it is now; it shares the weights with the run."""
        training = {
            "seed": self.seed,
            **self.done,
            **provenance(),
            **self._processor(),
            "validation": self.validation_rows[-1] if self.validation_rows else None,
        }
        learner = self.learner
        return Agent(learner.online, learner.observation, self.recipe, self.scenario, training)

    @property
    def finished(self) -> bool:
        return self.steps >= self.recipe.steps

    def is_finite(self) -> bool:
        """Whether the losses and all weights are still finite."""
        weights = (part.isfinite().all() for part in self.learner.online.parameters())
        return bool(np.isfinite(self.losses).all() and all(weights))

    def save(self, path: Path) -> None:
        """Write everything the run needs to go on as if it had never stopped."""
        parts: dict[str, dict] = {
            "ddqn": self.learner.state_dict(),
            "replay": self.replay.state_dict(),
            "state": {name: array.copy() for name, array in vars(self.state).items()},
            "in_flight": {"from_start": self.from_start, "returns": self.returns},
        }
        tensors = {
            f"{part}.{name}": torch.as_tensor(value)
            for part, values in parts.items()
            for name, value in values.items()
        }
        progress = {name: getattr(self, name) for name in self.PROGRESS}
        generators = [g.bit_generator.state for g in (self.generator, self.greedy_generator)]
        others = {"generators": generators, "flown_over": described(self.environment.cities)}
        save(path, "training", tensors, self.identity() | progress | others)

    def restore(self, path: Path) -> None:
        """Go on from what `save` wrote; `InputError` if that is another run."""
        tensors, about = load(path, "training")
        for name, value in self.identity().items():
            if about.get(name) == value:
                continue
            if name == "cities":  # fingerprints, which tell a reader nothing
                there, here = about.get("flown_over"), described(self.environment.cities)
                raise InputError(f"{path}: its cities have other cells: {there} there, {here} here")
            difference = _difference(about.get(name), value)
            raise InputError(f"{path}: another {name} than asked for{difference}")
        arrays: dict[str, dict] = {}
        for key, tensor in tensors.items():
            part, name = key.split(".", 1)
            arrays.setdefault(part, {})[name] = tensor if part == "ddqn" else tensor.numpy()
        self.learner.load_state_dict(arrays["ddqn"])
        self.replay.load_state_dict(arrays["replay"])
        self.state = State(**arrays["state"])
        self.from_start, self.returns = (arrays["in_flight"][k] for k in ("from_start", "returns"))
        for name in self.PROGRESS:
            setattr(self, name, about[name])
        for generator, state in zip(
            (self.generator, self.greedy_generator), about["generators"], strict=True
        ):
            generator.bit_generator.state = state

    def identity(self) -> dict:
        """What defines the run: recipe, scenario, cities, seed, device and threads, as JSON values.

        A saved run can only go on as this one if all of it is equal.
        """
        values = {
            "recipe": self.recipe.as_json(),
            "scenario": asdict(self.scenario),
            "cities": fingerprint_of(self.environment.cities),
            "seed": self.seed,
            **self._processor(),
        }
        return json.loads(json.dumps(values))  # tuples become lists, as in a file

    def _processor(self) -> dict:
        """What computes it; elsewhere, rounding is different, and soon the weights are."""
        return {"device": self.device, "threads": torch.get_num_threads()}


def trainer_of(recipe: Recipe) -> type[Trainer]:
    """The class that runs this recipe's training."""
    return resolve_name(recipe.trainer)


def _difference(saved, asked) -> str:
    """The fields in which two JSON values differ, for an error."""
    if not isinstance(saved, dict):
        return f": {saved} there, {asked} here"
    names = [k for k in sorted(saved.keys() | asked.keys()) if saved.get(k) != asked.get(k)]
    return "; " + ", ".join(f"{k}: {saved.get(k)} there, {asked.get(k)} here" for k in names)

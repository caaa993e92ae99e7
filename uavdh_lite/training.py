"""The training loop: act, step, remember, learn.

`Trainer.step` is the loop. The rest keeps the books: the learning curve, the validations, and the
state from which a stopped run goes on.
"""

import time
from pkgutil import resolve_name

import numpy as np
import torch
from torch import Tensor

from uavdh_lite.agent import Agent
from uavdh_lite.city import City, load_cities
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
TEST_FLIGHTS = 50  # least number that choose an agent, as in the authors' code
VALIDATION_SEED = 0


class Trainer:
    """One training run, step by step; `experiments.runs.train` runs it with files and progress.

    The same scenario, cities, recipe, seed, device and number of torch's threads give the same
    weights on one machine.

    The learning curve has only episodes that began as missions do, at a landing zone and with all
    the data to collect, because exploring starts compare with no evaluation.

    Arguments:
        city: the city or cities to fly over; the scenario's own if None.
        device: `cpu`, `cuda` or `mps`.

    Raises `InputError` for anything but a scenario, a recipe, a seed and cities.
    """

    # The attributes that make up the state and are JSON values; a subclass adds its own
    JSON_STATE: tuple[str, ...] = (
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
        for name, given, right in (("scenario", scenario, Scenario), ("recipe", recipe, Recipe)):
            if not isinstance(given, right):
                raise InputError(
                    f"a training's {name} is a {right.__name__}, here is {shown(given)}: "
                    f"find_{name} gives that of a name"
                )
        if not isinstance(self, kind := trainer_of(recipe)):
            raise InputError(
                f"recipe {recipe.name} is trained by {kind.__name__}, here is "
                f"{type(self).__name__}: trainer_of(recipe) gives the class"
            )
        self.scenario, self.recipe, self.seed = scenario, recipe, seed
        self.environment = recipe.environment_for(
            load_cities(scenario.city) if city is None else city, scenario.channel
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
        # Since the last row of the learning curve
        self.episodes: list[list[float]] = []  # `CURVES` of each that ended and began as a mission
        self.ended = 0  # how many ended in all
        self.losses: list[float] = []
        # Of the episodes in flight: whether they began as missions do, and the reported return
        self.from_start = np.ones(recipe.environments, bool)
        self.returns = np.zeros(recipe.environments)
        self.state = self._starts(np.arange(recipe.environments))

    def advance(self) -> bool:
        """A step and, where one is due, a validation; whether there is something to keep.

        That is a validation's row, or the best agent so far.
        """
        started, before, rows = time.perf_counter(), self.steps, len(self.training_rows)
        self.step()
        interval = self.recipe.validation_interval
        due = self.finished or self.steps // interval > before // interval
        if due:
            self.validate()
        self.seconds += time.perf_counter() - started
        return due or (len(self.training_rows) > rows and self.is_best)

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
        """Note the metrics of the episodes that ended, and begin new ones in their place."""
        ended = np.flatnonzero(state.ended)
        landed, collected = state.landed.astype(float), state.collected.astype(float)
        metrics = np.stack([self.returns, landed, collected, collected * landed], axis=1)
        self.episodes += metrics[ended[self.from_start[ended]]].tolist()
        self.ended += len(ended)
        return state.with_rows(ended, self._starts(ended)) if len(ended) else state

    def _starts(self, environments: np.ndarray) -> State:
        """The starts of new episodes for these environments."""
        state, drawn = self._draw_starts(len(environments))
        self.from_start[environments] = drawn >= self.recipe.exploring_starts
        self.returns[environments] = 0
        return state

    def _draw_starts(self, count: int) -> tuple[State, np.ndarray]:
        """The starts of `count` episodes, and a number from [0, 1) that was drawn for each.

        Where it is below the recipe's share of exploring starts, the episode is under way.
        """
        scenario, recipe, generator = self.scenario, self.recipe, self.generator
        state = scenario.sample(self.environment, count, generator)
        drawn = generator.random(count)
        exploring = drawn < recipe.exploring_starts
        if exploring.any():
            under_way = scenario.sample_anywhere(
                self.environment, exploring.sum(), generator, recipe.exploring_spare_time
            )
            state = state.with_rows(exploring, under_way)
        return state, drawn

    def _add_row(self) -> None:
        """A row of the learning curve: means since the row before, None where there are none.

        Its greedy flights are over new random missions, one for ten episodes that ended.
        """
        means = np.mean(self.episodes, axis=0).tolist() if self.episodes else [None] * len(CURVES)
        row = {**self.progress, "episodes": len(self.episodes)}
        row |= dict(zip(CURVES, means, strict=True))
        row["loss"] = float(np.mean(self.losses)) if self.losses else None
        row["temperature"] = self.recipe.temperature_at(self.steps)
        row["learning_rate"] = self.recipe.learning_rate_at(self.steps)
        self.training_rows.append(row | self._greedy_flights())
        self.episodes, self.ended, self.losses = [], 0, []

    def _greedy_flights(self) -> dict:
        """How the agent as it is now flies by its greedy policy (eq. 9)."""
        flights = self.ended // EPISODES_PER_GREEDY_FLIGHT
        records: dict = {}
        if flights:
            start = self.scenario.sample(self.environment, flights, self.greedy_generator)
            records = fly(self.environment, self.agent, start, self.greedy_generator).records()
        means = {f"greedy_{k}": float(records[k].mean()) if flights else None for k in CURVES}
        return {"greedy_flights": flights} | means

    def validate(self) -> None:
        """Fly the validation missions by the greedy policy (eq. 9): a row of their means.

        They are the same for every run of a scenario.
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
        self.validation_rows.append(self.progress | means)

    @property
    def is_best(self) -> bool:
        """Whether the agent as it is now has just been judged, and is the best so far."""
        return self.steps == self.best_steps

    @property
    def best_steps(self) -> int | None:
        """After how many steps the agent was the best so far; None if none was judged yet.

        Of equal ones the first counts. A run too short to judge any keeps the last.
        """
        scores = judged(self.recipe, self.training_rows, self.validation_rows)
        return max(scores, key=scores.__getitem__, default=self.steps if self.finished else None)

    @property
    def progress(self) -> dict:
        """Environment steps, updates and seconds so far, for the rows of tables."""
        return {"steps": self.steps, "updates": self.updates, "seconds": round(self.seconds, 1)}

    @property
    def agent(self) -> Agent:
        """The agent as it is now; it shares the weights with the run."""
        training = {
            "seed": self.seed,
            **self.progress,
            **provenance(),
            "device": self.device,
            "threads": torch.get_num_threads(),
            "validation": self.validation_rows[-1] if self.validation_rows else None,
        }
        learner = self.learner
        return Agent(learner.online, learner.observation, self.recipe, self.scenario, training)

    @property
    def finished(self) -> bool:
        """Whether the recipe's steps are done."""
        return self.steps >= self.recipe.steps

    def is_finite(self) -> bool:
        """Whether the losses and all weights are still finite."""
        weights = (part.isfinite().all() for part in self.learner.online.parameters())
        return bool(np.isfinite(self.losses).all() and all(weights))

    def state_dict(self) -> tuple[dict[str, Tensor], dict]:
        """What the run needs to go on as if it had never stopped: tensors, and JSON values."""
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
        values = {name: getattr(self, name) for name in self.JSON_STATE}
        generators = self.generator, self.greedy_generator
        values["generators"] = [generator.bit_generator.state for generator in generators]
        return tensors, values

    def load_state_dict(self, tensors: dict[str, Tensor], values: dict) -> None:
        """Go on from what `state_dict` gave for the same run."""
        parts: dict[str, dict] = {}
        for key, tensor in tensors.items():
            part, name = key.split(".", 1)
            parts.setdefault(part, {})[name] = tensor if part == "ddqn" else tensor.numpy()
        self.learner.load_state_dict(parts["ddqn"])
        self.replay.load_state_dict(parts["replay"])
        self.state = State(**parts["state"])
        self.from_start, self.returns = (parts["in_flight"][k] for k in ("from_start", "returns"))
        for name in self.JSON_STATE:
            setattr(self, name, values[name])
        first, second = values["generators"]
        self.generator.bit_generator.state = first
        self.greedy_generator.bit_generator.state = second


def judged(recipe: Recipe, training: list[dict], validation: list[dict]) -> dict[int, float]:
    """The score of each agent of a run that was judged, by its steps; see `Recipe.kept_by`.

    In test flights it is their mean over whole rows of the learning curve, as few of the last ones
    as have `TEST_FLIGHTS`. The rows are those of the run's two tables.
    """
    if recipe.kept_by == "validation":
        return {row["steps"]: row["return"] for row in validation}
    flights = np.array([row["greedy_flights"] for row in training])
    score = np.array([row["greedy_collected_and_landed"] or 0.0 for row in training])
    scores = {}
    for end in range(1, len(training) + 1):
        enough = np.flatnonzero(flights[:end][::-1].cumsum() >= TEST_FLIGHTS)
        if len(enough):
            last = slice(end - 1 - enough[0], end)
            mean = np.average(score[last], weights=flights[last])
            scores[training[end - 1]["steps"]] = float(mean)
    return scores


def trainer_of(recipe: Recipe) -> type[Trainer]:
    """The class that runs this recipe's training."""
    return resolve_name(recipe.trainer)

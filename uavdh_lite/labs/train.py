"""One training run, or a race of two, in a thread of its own."""

import copy
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from uavdh_lite.agent import Agent
from uavdh_lite.beyond.recipes import BeyondRecipe
from uavdh_lite.city import City
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import Trajectory, evaluate
from uavdh_lite.labs.state import scenario_of
from uavdh_lite.missions import Mission
from uavdh_lite.recipe import find_recipe
from uavdh_lite.streams import Use
from uavdh_lite.training import Trainer

LARGEST = 10  # cells on a side of a city in which half a minute is enough
EPISODES = 100  # missions of a point
TURN = 16  # steps of one run before the other has its turn
EVERY = 1.0  # seconds between points
FOR_GOOD = 0.5  # of the missions of a point and of all later ones: it has learned to land
COLOURS = ("blue", "orange")  # of the runs
METRICS = ("collected_and_landed", "collected", "landed", "return")
SMALL = "Crashing costs 5 at first and 20 at the end, so that it dares to explore."
NO_FEAR = "A crash costs nothing. Will it come home?"
FEAR = "A crash costs 150 from the first step on. Will it dare to leave?"
SAFE = "Actions after which the way home is too long are not allowed: it need not learn to land."
NOT_YET = "has not learned to land for good"
SETTINGS: dict[str, tuple[str, str, dict[str, Any]]] = {  # title, what it is, changes of the recipe
    "small": ("the usual recipe", SMALL, {}),
    "no fear": ("no fear of crashing", NO_FEAR, {"crash_reward": 0.0, "crash_reward_end": None}),
    "fear": ("−150 from the start", FEAR, {"crash_reward": -150.0, "crash_reward_end": None}),
    "failsafe": ("failsafe", SAFE, {"failsafe": True, "exploring_starts": 0.0}),
}


@dataclass
class Run:
    """One training with its points: the metrics at some steps, and the agents that got them."""

    setting: str
    trainer: Trainer
    points: list[dict] = field(default_factory=list)
    agents: list[Agent] = field(default_factory=list)

    def measure(self) -> None:
        """Add a point: how the agent does now, over missions that it does not learn from."""
        trainer = self.trainer
        frozen = trainer.agent
        frozen = replace(frozen, network=copy.deepcopy(frozen.network))
        scenario = trainer.scenario
        flights = evaluate(trainer.environment, frozen, scenario, EPISODES, 0, Use.VALIDATION)
        records = flights.records()
        point = {metric: round(float(records[metric].mean()), 4) for metric in METRICS}
        self.points.append({"steps": trainer.steps, **point})
        self.agents.append(frozen)

    @property
    def kink(self) -> int | None:
        """The point at which it learned to land: from there to the last one, half or more land."""
        fails = [k for k, point in enumerate(self.points) if point["landed"] < FOR_GOOD]
        return fails[-1] + 1 if fails and fails[-1] + 1 < len(self.points) else None


class Race:
    """Runs that take turns; with equal settings their seeds differ.

    Arguments:
        settings: names of `SETTINGS`, one or two.
        seed: of the first run.
        told: called after each point, in the thread.
    """

    def __init__(self, city: City, settings: list[str], seed: int, told: Callable[[], None]):
        small = BeyondRecipe(**asdict(find_recipe("small")))
        other = seed + int(len(set(settings)) < 2)
        self.runs = [
            Run(name, Trainer(scenario_of(city), replace(small, **SETTINGS[name][2]), each, city))
            for name, each in zip(settings, (seed, other), strict=False)
        ]
        self.city, self.steps = city, small.steps
        self.error = ""
        self._told, self._pause = told, threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def running(self) -> bool:
        return self._thread is not None and self._thread.is_alive() and not self._pause.is_set()

    @property
    def finished(self) -> bool:
        return all(run.trainer.finished for run in self.runs)

    def go_on(self) -> None:
        """Train in a thread, until it is paused or finished."""
        if not self.running and not self.finished:
            self.pause()
            self._pause.clear()
            self._thread = threading.Thread(target=self._train, daemon=True)
            self._thread.start()

    def pause(self) -> None:
        """Stop after this turn, and wait for it."""
        self._pause.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()

    def flight(self, run: int, point: int, mission: Mission) -> Trajectory:
        """The flight of the agent that got this point."""
        try:
            agent = self.runs[run].agents[point]
        except (IndexError, TypeError):
            raise InputError(f"run {run} has no point {point}") from None
        agent = agent.over(mission.city)
        return mission.fly(agent.environment, agent).trajectory(0)

    def _train(self) -> None:
        try:
            if not self.runs[0].points:
                self._measure()
            before = time.monotonic()
            while not self._pause.is_set() and not self.finished:
                for run in self.runs:
                    for _ in range(TURN):
                        run.trainer.step()
                if time.monotonic() - before >= EVERY or self.finished:
                    self._measure()
                    before = time.monotonic()
        except Exception as error:  # whatever it is, the reader must see it
            self.error = f"{type(error).__name__}: {error}"
        self._pause.set()
        self._told()

    def _measure(self) -> None:
        for run in self.runs:
            run.measure()
        self._told()


def sentences(runs: list[Run], finished: bool) -> list[str]:
    """What the kink of each curve means, and after the race how both did and who wins."""
    told, ends, homes = [], [], []
    for colour, run in zip(COLOURS, runs, strict=False):
        landed = [round(EPISODES * point["landed"]) for point in run.points]
        if run.kink is not None:
            before, now = landed[run.kink - 1 : run.kink + 1]
            steps = f"{run.points[run.kink]['steps']:,} steps"
            told.append(
                f"{colour} learns to land for good here, after {steps}: "
                f"{before} of {EPISODES} before, {now} then."
            )
            best = landed.index(max(landed[: run.kink]))
            if landed[best] >= FOR_GOOD * EPISODES:
                steps = f"{run.points[best]['steps']:,} steps"
                told.append(f"after {steps} {landed[best]} landed, but it forgot how.")
        elif run.points:
            ever = run.points[-1]["landed"] >= FOR_GOOD
            told.append(f"{colour} {'lands from the start' if ever else NOT_YET}.")
        if finished:
            homes.append(round(100 * run.points[-1]["collected_and_landed"]))
            share = f"{homes[-1]}\N{NO-BREAK SPACE}% of the data"
            ends.append(f"{colour} lands {landed[-1]} of {EPISODES} and brings {share} home")
    if finished:
        wins = COLOURS[homes.index(max(homes))]
        level = len(homes) < 2 or abs(homes[0] - homes[1]) <= 1
        told.append(f"{'in the end' if level else f'{wins} wins'}: {'; '.join(ends)}.")
    return [sentence.capitalize() for sentence in told]


def scene(race: Race | None, point: tuple[int, int] | None) -> dict[str, Any]:
    """The settings, the curves so far, and the point whose agent flies."""
    about = {name: [title, text] for name, (title, text, _) in SETTINGS.items()}
    shown = {"settings": about, "largest": LARGEST}
    if race is None:
        return {**shown, "runs": [], "running": False}
    return {
        **shown,
        "runs": [  # the kink first: the thread may add a point meanwhile
            {
                "kink": run.kink,
                "setting": run.setting,
                "title": SETTINGS[run.setting][0],
                "points": run.points[:],
            }
            for run in race.runs
        ],
        "sentences": sentences(race.runs, race.finished),
        "steps": race.steps,
        "running": race.running,
        "finished": race.finished,
        "error": race.error,
        "point": point,
    }

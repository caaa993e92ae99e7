"""Training live: start, watch, pause and continue, while other cells of the notebook can run."""

import atexit
import textwrap
import threading
import time
import weakref
from dataclasses import asdict, replace

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from uavdh_lite.beyond.recipes import BeyondRecipe
from uavdh_lite.errors import InputError, extra
from uavdh_lite.evaluation import Flights
from uavdh_lite.experiments.runs import validate
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.labs.stage import BESIDE, FullScreen, Stage, together
from uavdh_lite.labs.widgets import WRAP, status, words
from uavdh_lite.missions import Mission
from uavdh_lite.plotting import BLUE, ORANGE, RED
from uavdh_lite.recipe import Recipe, find_recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.training import Trainer

with extra("notebooks"):
    import ipywidgets
    import traitlets

CURVES = {
    "landed": ("landed", "#999999"),
    "collected": ("collected", ORANGE),
    "collected_and_landed": ("collected and landed", BLUE),
}
YOURS, RIVAL = "your run", "the rival"
STYLES = {YOURS: "o-", RIVAL: "--"}
OLD_STYLES = {YOURS: ":", RIVAL: "-."}  # of the run before
WORDS = {
    "what happens": "the agent flies the village again and again. From what it has seen, a small "
    "neural network learns how much each action is worth. Every 8000 steps it is tested in "
    "missions that it does not learn from: a validation",
    "recipe": "all constants of a training; this one is called <i>small</i>",
    "crash reward at first, and at the end of training": "what a crash costs. It grows in between, "
    "up to a seventh of what it costs the agents of the other labs, which are told of 150. Try "
    "-150 from the start: then it lands at once and collects nothing",
    "temperature": "how much it tries out at the beginning: high, any action; low, only what it "
    "thinks best",
    "return steps": "how many steps of real rewards count before its own estimate",
    "failsafe": "actions after which the way home is too long are not allowed, so it need not "
    "learn to land. Try this first",
    "quantiles": "it learns how returns are spread, not their mean alone",
    "advantage learning": "it widens the gap between the best action and the others. Both pay "
    "together with the failsafe",
    "race a second agent": "a rival trains next to yours, with the same seed. Its settings appear "
    "next to yours. As they come they are the recipe as it is; change them, and any two recipes "
    "race",
    "seed": "the number of the random draws. Two runs that differ only in it show how much is luck",
    "environment steps": "how many steps it has flown in all missions together",
    "updates": "how many times its network has been changed by what it learned",
    "landed": "the share of validation missions in which it landed in time",
    "collected": "the share of the data that it collected, whether it landed or not",
    "collected and landed": "the share of the data that it brought home; 0 where it did not land",
}
UNLOCK = "To change settings, press new run"
REFRESH = 0.3  # seconds between updates of the progress
PART, WIDE = {"width": "190px"}, {"description_width": "155px"}
SETTING, NAME = {"width": "385px"}, {"description_width": "275px"}
LETTERS = {"small": 76, "x-small": 92}  # of a line of the legend
TITLES = {
    "crash_reward": "crash reward at first",
    "crash_reward_end": "crash reward at the end of training",
}
SHORT = {"crash_reward": "crash reward", "crash_reward_end": "crash reward at the end"}
PARTS = {  # of the recipe `quantile`: what each one sets
    "failsafe": ("failsafe",),
    "quantiles": ("quantiles", "huber_delta"),
    "advantage learning": ("advantage_learning",),
}


class Settings(ipywidgets.HBox):
    """What can be changed of a recipe.

    Arguments:
        recipe: the values to start with.
        whose: stands before each setting's name.
    """

    def __init__(self, recipe: BeyondRecipe, whose: str = ""):
        self._recipe = recipe
        number = ipywidgets.FloatText
        self.values = {
            **{
                name: number(getattr(recipe, name), description=f"{whose}{title}")
                for name, title in TITLES.items()
            },
            "temperature": number(recipe.temperature, description=f"{whose}temperature"),
            "return_steps": ipywidgets.BoundedIntText(
                recipe.return_steps, min=1, max=20, description=f"{whose}return steps"
            ),
        }
        for value in self.values.values():
            value.style, value.layout = NAME, SETTING
        self.parts = {
            name: ipywidgets.Checkbox(description=f"{whose}{name}", indent=False, layout=PART)
            for name in PARTS
        }
        self.right = ipywidgets.VBox(list(self.parts.values()))
        super().__init__([ipywidgets.VBox(list(self.values.values())), self.right], layout=WRAP)

    @property
    def recipe(self) -> BeyondRecipe:
        """The recipe with these settings; `InputError` says which one cannot be."""
        changes = {name: setting.value for name, setting in self.values.items()}
        source = find_recipe("quantile")
        for part, names in PARTS.items():
            if self.parts[part].value:
                changes |= {name: getattr(source, name) for name in names}
        return replace(self._recipe, **changes)

    def lock(self, locked: bool) -> None:
        """Hold the settings, or free them."""
        for setting in (*self.values.values(), *self.parts.values()):
            setting.disabled = locked


class TrainingLab(ipywidgets.VBox):
    """A small training run in the background, its curves, and how the agent flies.

    With a tick at *race a second agent*, a rival trains next to it, step by step: the recipe
    without your changes, or any other one, if you change the rival's settings, too. The flights are
    those after the newest validation; a click on the curves, or the slider, shows those after
    another one. A run pauses when the lab is closed, and when the process ends. `running` says
    whether one is on.

    Arguments:
        scenario, recipe: names of presets; `recipe` may also be a `Recipe`.
    """

    running = traitlets.Bool(False)

    def __init__(self, scenario: str = "village", recipe: str | Recipe = "small"):
        self.scenario = find_scenario(scenario)
        recipe = find_recipe(recipe) if isinstance(recipe, str) else recipe
        self.recipe = BeyondRecipe(**asdict(recipe))  # its parts can be added
        self.yours, self.rival = Settings(self.recipe), Settings(self.recipe, "rival: ")
        self.settings, self.parts = self.yours.values, self.yours.parts
        self.race = ipywidgets.Checkbox(
            description="race a second agent",
            indent=False,
            layout=PART,
            tooltip="train a rival at the same time; its settings, too, can be changed",
        )
        self.yours.right.children = [*self.yours.right.children, self.race]
        self.seed = ipywidgets.BoundedIntText(
            description="seed", min=0, max=10**6, layout={"width": "200px"}
        )
        self.start = ipywidgets.Button(description="start", icon="play", button_style="primary")
        self.pause = ipywidgets.Button(
            description="pause training",
            icon="pause",
            disabled=True,
            tooltip="the flights pause, too",
        )
        self.new_run = ipywidgets.Button(
            description="new run",
            icon="undo",
            disabled=True,
            tooltip="forget this run, but keep its curves, and those of its rival",
        )
        self.progress = ipywidgets.IntProgress(min=0, max=self.recipe.steps, description="steps")
        self.status = ipywidgets.HTML()
        figure = Figure(figsize=(5.2, 4.9), dpi=100)
        self.ax = figure.add_axes((0.12, 0.34, 0.85, 0.59), facecolor="none")
        self.curves, self.stage = Canvas(figure, self._draw_again), Stage()
        self.stage.layout = BESIDE
        self.looked_at = ipywidgets.IntSlider(
            max=0,
            description="flight at validation",
            readout=False,  # the maps say after how many steps
            style=WIDE,
            layout={"width": "480px"},
        )
        self.views = ipywidgets.HBox([self.curves.picture, self.stage], layout=WRAP)
        self.curves.on_click(lambda ax, steps, _: self.look_at(steps))
        self.recipes = ipywidgets.HBox([self.yours], layout=WRAP)
        super().__init__(
            [
                self.recipes,
                together(
                    [
                        ipywidgets.HBox(
                            [
                                self.start,
                                self.pause,
                                self.new_run,
                                self.seed,
                                self.progress,
                                FullScreen(),
                            ],
                            layout=WRAP,
                        ),
                        self.status,
                        self.looked_at,
                        self.views,
                    ]
                ),
                words(WORDS),
            ]
        )
        self.looked_at.observe(lambda _: self._show_flights(), "value")
        self.race.observe(lambda change: self._show_rival(change.new), "value")
        self.start.on_click(lambda _: self.run())
        self.pause.on_click(lambda _: self._pause())
        self.new_run.on_click(lambda _: self.reset())
        self.trainers: dict[str, Trainer] = {}  # yours comes first
        self.previous: dict[str, list[dict]] = {}  # validations of the run before, and its rival
        self._before: dict[str, str] = {}  # how their recipes differed
        self.flown: list[dict[str, Flights]] = []  # the same mission after each validation
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._drawing = threading.RLock()  # the run draws, and so does who looks at its flights
        # A thread that still computes would crash the interpreter at its exit
        atexit.register(_close, weakref.ref(self))
        self.reset()

    def run(self) -> None:
        """Start or continue the run in a thread of its own."""
        if self._thread is not None and self._thread.is_alive():
            return
        try:
            self.trainers = self.trainers or self._new()
        except InputError as error:
            self._say(str(error), error=True)
            return
        self._stop.clear()
        self._say("starting …")
        self._set_running(True)
        self._thread = threading.Thread(target=self._train, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Pause after the current step; `run` continues with the same result as without a pause."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def _pause(self) -> None:
        """Pause the run, and the flights with it."""
        self.stop()
        self.stage.begin = -1
        self.stage.put_back()

    def reset(self) -> None:
        """Forget the run, so that the settings can be changed."""
        self.stop()
        if self.trainers:
            self.previous = {name: each.validation_rows for name, each in self.trainers.items()}
            self._before = {name: self._changes(name) for name in self.trainers}
        self.trainers, self.progress.value, self.flown = {}, 0, []
        self.looked_at.max = 0
        self.stage.layout.display = self.looked_at.layout.display = "none"
        self._draw_curves()
        self.curves.draw(alt="Curves of the previous run, if there was one")
        self._set_running(False)
        self._say("change the settings, then start")

    def close(self) -> None:
        """Pause the run for good and take the lab off the page."""
        self.stop()
        super().close()

    def _show_rival(self, races: bool) -> None:
        self.recipes.children = [self.yours, self.rival] if races else [self.yours]

    def _new(self) -> dict[str, Trainer]:
        recipes = {YOURS: self.yours.recipe}
        if self.race.value:
            try:
                recipes[RIVAL] = self.rival.recipe
            except InputError as error:
                raise InputError(f"the rival's settings: {error}") from None
        trainers = {
            name: Trainer(self.scenario, recipe, self.seed.value)
            for name, recipe in recipes.items()
        }
        self.mission = Mission.draw(self.scenario, trainers[YOURS].environment.cities[0], 0)
        for trainer in trainers.values():
            validate(trainer)
        return trainers

    def _train(self) -> None:
        """In the thread: train until the runs are paused or finished; show what goes wrong."""
        trainers, looked = list(self.trainers.values()), 0.0
        interval = self.recipe.validation_interval
        try:
            self._show_agents()
            while not self._stop.is_set():
                trainer = min(trainers, key=lambda each: each.steps)  # they take turns
                if trainer.finished:
                    break
                before, started = trainer.steps, time.perf_counter()
                trainer.step()
                trainer.seconds += time.perf_counter() - started
                if trainer.steps // interval > before // interval or trainer.finished:
                    validate(trainer)
                    self._show_agents()
                if time.perf_counter() - looked > REFRESH:
                    looked = time.perf_counter()
                    self.progress.value = trainer.steps
            self.progress.value = min(trainers[-1].steps, self.recipe.steps)
            finished = all(trainer.finished for trainer in trainers)
            self._say(f"{'finished' if finished else 'paused'}: {self._result()}. {UNLOCK}")
        except Exception as error:  # whatever it is, the reader must see it
            self._say(f"{type(error).__name__}: {error}", error=True)
        finally:
            self._set_running(False)

    def _set_running(self, running: bool) -> None:
        made = bool(self.trainers)
        done = made and all(trainer.finished for trainer in self.trainers.values())
        self.start.description = "go on" if made and not done else "start"
        self.start.disabled, self.pause.disabled = running or done, not running
        self.new_run.disabled = running or not made
        self.yours.lock(made)
        self.rival.lock(made)
        self.race.disabled = self.seed.disabled = made
        self.running = running

    def _rows(self) -> list[dict]:
        """Your validations, as many as all runs have made."""
        made = min(len(trainer.validation_rows) for trainer in self.trainers.values())
        return self.trainers[YOURS].validation_rows[:made]

    def _show_agents(self) -> None:
        """Show the curves so far, and a flight of each agent once all have been validated."""
        if len(self.flown) < len(self._rows()):  # not yet seen before a pause
            self.flown.append(
                {
                    name: self.mission.fly(trainer.environment, trainer.agent)
                    for name, trainer in self.trainers.items()
                }
            )
        last = len(self.flown) - 1
        with self._drawing:
            self.looked_at.max = last
            self.stage.layout.display = self.looked_at.layout.display = None
            self._draw_curves()
            if self.looked_at.value == last:
                self._show_flights()
            self.looked_at.value = last
            self._say(self._result())

    def look_at(self, steps: float) -> None:
        """Show the flight after the validation that is nearest to so many steps."""
        if self.flown:
            rows = self._rows()
            numbers = range(len(self.flown))
            self.looked_at.value = min(numbers, key=lambda k: abs(rows[k]["steps"] - steps))

    def _show_flights(self) -> None:
        """Play the flights of a validation, and mark it on the curves."""
        number = self.looked_at.value
        if number >= len(self.flown):  # a new run has none yet
            return
        steps = self._rows()[number]["steps"]
        named = {f"{name} after {steps:,} steps": each for name, each in self.flown[number].items()}
        with self._drawing:
            self.stage.show(self.trainers[YOURS].environment, named, begin=0)
            self._mark(steps)

    def _result(self) -> str:
        """How far the runs are, with the last validation of each."""
        yours, results = self.trainers[YOURS], []
        last = len(self._rows()) - 1
        for name, trainer in self.trainers.items():
            row = trainer.validation_rows[last]
            results.append(
                f"{name} landed {row['landed']:.0%}, "
                f"collected and landed {row['collected_and_landed']:.0%}"
            )
        return (
            f"{yours.steps:,} steps, {yours.updates:,} updates, {yours.seconds:.0f} s. Validation "
            f"after {yours.validation_rows[last]['steps']:,} steps: {'; '.join(results)}"
        )

    def _changes(self, name: str) -> str:
        """In what a run's recipe differs from the one that the lab starts with."""
        return _differences(self.trainers[name].recipe.as_json(), self.recipe.as_json())

    def _draw_curves(self) -> None:
        """Yours as lines with points, the rival's dashed; those of the run before, dotted."""
        self.ax.clear()
        drawn = [(OLD_STYLES[name], 0.6, rows) for name, rows in self.previous.items()]
        drawn += [(STYLES[name], 1, run.validation_rows) for name, run in self.trainers.items()]
        for metric, (_, colour) in CURVES.items():
            for style, alpha, rows in reversed(drawn):
                x, y = [row["steps"] for row in rows], [row[metric] for row in rows]
                self.ax.plot(x, y, style, color=colour, alpha=alpha)
        edge = 0.02 * self.recipe.steps  # so that points at the ends are whole
        self.ax.set(xlim=(-edge, self.recipe.steps + edge), ylim=(-0.03, 1.03))
        self.ax.set(xlabel="environment steps", ylabel="share of missions, or of their data")
        for old in self.ax.figure.legends[:]:
            old.remove()
        self._explain_colours()
        self._explain_runs()
        self.curves.draw_all()

    def _explain_colours(self) -> None:
        """The legend above the curves."""
        lines = [Line2D([], [], marker="o", color=c, label=label) for label, c in CURVES.values()]
        self.ax.legend(
            handles=lines,
            loc="lower left",
            bbox_to_anchor=(-0.03, 1),
            ncols=len(lines),
            fontsize="small",
            frameon=False,
            columnspacing=1.2,
        )

    def _explain_runs(self) -> None:
        """The legend below the curves, if they are of more than one run."""
        runs = {STYLES[name]: f"{name}{self._changes(name)}" for name in self.trainers}
        runs |= {
            OLD_STYLES[name]: f"{'the run' if name == YOURS else name} before{changes}"
            for name, changes in self._before.items()
        }
        if len(runs) < 2:
            return
        size = "small" if len(runs) == 2 else "x-small"
        lines = [
            Line2D([], [], color="black", ls=style.strip("o"), marker="o" if "o" in style else "")
            for style in runs
        ]
        self.ax.figure.legend(
            lines,
            [textwrap.fill(label, LETTERS[size]) for label in runs.values()],
            loc="upper left",
            bbox_to_anchor=(0, 0.245),
            fontsize=size,
            frameon=False,
            labelspacing=0.3,
        )

    def _draw_again(self) -> None:
        """Draw the curves in the page's new colours."""
        with self._drawing:
            self._draw_curves()
            if self.flown:
                self._mark(self._rows()[self.looked_at.value]["steps"])
            else:
                self.curves.draw()

    def _mark(self, steps: int) -> None:
        """Mark the validation whose flight is shown."""
        line = self.ax.axvline(steps, color="black", lw=0.8, animated=True)
        self.curves.draw([(self.ax, line)], f"Curves of the validations; {self._result()}")
        line.remove()

    def _say(self, text: str, error: bool = False) -> None:
        self.status.value = status(text, RED if error else "inherit")


def _differences(recipe: dict, source: dict) -> str:
    """In what a recipe differs from another one, for a legend."""
    parts = {name: part for part, names in PARTS.items() for name in names}
    changed = [name for name, value in recipe.items() if value != source[name]]
    said = dict.fromkeys(
        parts.get(name) or f"{SHORT.get(name, name)} {recipe[name]:g}".replace("_", " ")
        for name in changed
    )
    return f": {', '.join(said)}" if said else ""


def _close(lab: weakref.ref) -> None:
    if (alive := lab()) is not None:
        alive.close()

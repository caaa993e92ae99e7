"""Training live: start, watch, pause and continue, while other cells of the notebook can run."""

import atexit
import threading
import time
import weakref
from dataclasses import replace

from matplotlib.figure import Figure

from uavdh_lite.errors import InputError, extra
from uavdh_lite.evaluation import Flights
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
    "has_landed": ("landed", "#999999"),
    "collection_ratio": ("collected", ORANGE),
    "collection_ratio_and_landed": ("collected and landed", BLUE),
}
YOURS, RIVAL, CHANGED = "your run", "the recipe", "the rival"
WORDS = {
    "what happens": "the agent flies the village again and again. From what it has seen, a small "
    "neural network learns how much each action is worth. Every 8000 steps it is tested in "
    "missions that it does not learn from: a validation",
    "recipe": "all constants of a training; this one is called <i>small</i>",
    "crash reward": "what a crash costs at the beginning of the training, and at the end. Try -150 "
    "from the start: then it lands at once and collects nothing",
    "temperature": "how much it tries out at the beginning: high, any action; low, only what it "
    "thinks best",
    "return steps": "how many steps of real rewards count before its own estimate",
    "failsafe": "actions after which the way home is too long are not allowed, so it need not "
    "learn to land. Try this first",
    "quantiles": "it learns how returns are spread, not their mean alone",
    "advantage learning": "it widens the gap between the best action and the others. Both pay "
    "together with the failsafe",
    "race the recipe": "the recipe as it is trains next to yours, with the same seed. Its settings "
    "appear next to yours: change them, and any two recipes race",
    "seed": "the number of the random draws. Two runs that differ only in it show how much is luck",
    "landed": "the share of validation missions in which it landed in time",
    "collected and landed": "the share of the data that it brought home; 0 where it did not land",
}
UNLOCK = "To change settings, press new run"
REFRESH = 0.3  # seconds between updates of the progress
PART, WIDE = {"width": "190px"}, {"description_width": "155px"}
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

    def __init__(self, recipe: Recipe, whose: str = ""):
        self._recipe = recipe
        number = ipywidgets.FloatText
        self.values = {
            "crash_reward": number(recipe.crash_reward, description=f"{whose}crash reward"),
            "crash_reward_end": number(
                recipe.crash_reward_end, description=f"{whose}crash reward, end"
            ),
            "temperature": number(recipe.temperature, description=f"{whose}temperature"),
            "return_steps": ipywidgets.BoundedIntText(
                recipe.return_steps, min=1, max=20, description=f"{whose}return steps"
            ),
        }
        for value in self.values.values():
            value.style = WIDE
        self.parts = {
            name: ipywidgets.Checkbox(description=f"{whose}{name}", indent=False, layout=PART)
            for name in PARTS
        }
        self.right = ipywidgets.VBox(list(self.parts.values()))
        super().__init__([ipywidgets.VBox(list(self.values.values())), self.right], layout=WRAP)

    @property
    def recipe(self) -> Recipe:
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

    With a tick at *race*, the recipe without your changes trains next to it, step by step; or any
    other one, if you change the rival's settings, too. The flights are those after the newest
    validation; a click on the curves, or the slider, shows those after another one. A run pauses
    when the lab is closed, and when the process ends. `running` says whether one is on.

    Arguments:
        scenario, recipe: names of presets; `recipe` may also be a `Recipe`.
    """

    running = traitlets.Bool(False)

    def __init__(self, scenario: str = "village", recipe: str | Recipe = "small"):
        self.scenario = find_scenario(scenario)
        self.recipe = find_recipe(recipe) if isinstance(recipe, str) else recipe
        self.yours, self.rival = Settings(self.recipe), Settings(self.recipe, "rival: ")
        self.settings, self.parts = self.yours.values, self.yours.parts
        self.race = ipywidgets.Checkbox(
            description="race the recipe",
            indent=False,
            layout=PART,
            tooltip="train the recipe at the same time; its settings, too, can be changed",
        )
        self.yours.right.children = [*self.yours.right.children, self.race]
        self.seed = ipywidgets.BoundedIntText(
            description="seed", min=0, max=10**6, layout={"width": "200px"}
        )
        self.start = ipywidgets.Button(description="start", icon="play", button_style="primary")
        self.pause = ipywidgets.Button(description="pause", icon="pause", disabled=True)
        self.new_run = ipywidgets.Button(
            description="new run",
            icon="undo",
            disabled=True,
            tooltip="forget this run, but keep its curves",
        )
        self.progress = ipywidgets.IntProgress(min=0, max=self.recipe.steps, description="steps")
        self.status = ipywidgets.HTML()
        figure = Figure(figsize=(5.2, 4.2), dpi=100)
        self.ax = figure.add_axes((0.12, 0.13, 0.83, 0.72), facecolor="none")
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
        self.pause.on_click(lambda _: self.stop())
        self.new_run.on_click(lambda _: self.reset())
        self.trainers: dict[str, Trainer] = {}  # yours comes first
        self.previous: list[dict] = []  # validations of the previous run
        self._before = ""  # how its recipe differed
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

    def reset(self) -> None:
        """Forget the run, so that the settings can be changed."""
        self.stop()
        if self.trainers:
            self.previous = self.trainers[YOURS].validation_rows
            changed = self.trainers[YOURS].recipe, self.recipe
            self._before = _differences(*(each.as_json() for each in changed))
        for trainer in self.trainers.values():
            trainer.close()
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
        for trainer in self.trainers.values():
            trainer.close()
        super().close()

    def _show_rival(self, races: bool) -> None:
        self.recipes.children = [self.yours, self.rival] if races else [self.yours]

    def _new(self) -> dict[str, Trainer]:
        recipes = {YOURS: self.yours.recipe}
        if self.race.value:
            try:
                rival = self.rival.recipe
            except InputError as error:
                raise InputError(f"the rival's settings: {error}") from None
            recipes[RIVAL if rival == self.recipe else CHANGED] = rival
        trainers = {
            name: Trainer(self.scenario, recipe, self.seed.value)
            for name, recipe in recipes.items()
        }
        self.mission = Mission.draw(self.scenario, trainers[YOURS].city, 0)
        for trainer in trainers.values():
            trainer.validate()
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
                    trainer.validate()
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
        yours = self.trainers[YOURS]
        results = []
        for name, trainer in self.trainers.items():
            row = trainer.validation_rows[-1]
            results.append(
                f"{name} landed {row['has_landed']:.0%}, "
                f"collected and landed {row['collection_ratio_and_landed']:.0%}"
            )
        return (
            f"after {yours.steps:,} steps, {yours.updates:,} updates, {yours.seconds:.0f} s: "
            + "; ".join(results)
        )

    def _draw_curves(self) -> None:
        """Yours as lines with points, the rival's dashed, those of the run before dotted."""
        self.ax.clear()
        drawn = {"o-": [], "--": [], ":": self.previous}
        for style, trainer in zip(drawn, self.trainers.values(), strict=False):
            drawn[style] = trainer.validation_rows
        for metric, (label, colour) in CURVES.items():
            for style, rows in drawn.items():
                x, y = [row["steps"] for row in rows], [row[metric] for row in rows]
                alpha = 0.6 if style == ":" else 1.0
                self.ax.plot(x, y, style, color=colour, alpha=alpha)
            self.ax.plot([], [], "o-", color=colour, label=label)
        for name in list(self.trainers)[1:]:
            rival = self.trainers[name].recipe.as_json()
            changes = _differences(rival, self.recipe.as_json())
            self.ax.plot([], [], "k--", label=f"{name}{changes}")
        if self.previous:
            self.ax.plot([], [], "k:", label=f"the run before{self._before}")
        self.ax.set(xlim=(0, self.recipe.steps), ylim=(-0.03, 1.03), xlabel="environment steps")
        self.ax.legend(
            loc="lower left",
            bbox_to_anchor=(0, 1),
            ncols=2,
            fontsize="small",
            frameon=False,  # above the curves, which it would hide
        )
        self.curves.draw_all()

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
    said = dict.fromkeys(parts.get(n, f"{n} {recipe[n]:g}".replace("_", " ")) for n in changed)
    return f": {', '.join(said)}" if said else ""


def _close(lab: weakref.ref) -> None:
    if (alive := lab()) is not None:
        alive.close()

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
from uavdh_lite.labs.stage import BESIDE, Stage
from uavdh_lite.labs.widgets import WRAP, status
from uavdh_lite.missions import Mission
from uavdh_lite.plotting import BLUE, ORANGE, RED
from uavdh_lite.recipe import Recipe, find_recipe
from uavdh_lite.scenario import find_scenario
from uavdh_lite.training import Trainer

with extra("notebooks"):
    import ipywidgets

CURVES = {
    "has_landed": ("landed", "#999999"),
    "collection_ratio": ("collected", ORANGE),
    "collection_ratio_and_landed": ("collected and landed", BLUE),
}
REFRESH = 0.3  # seconds between updates of the progress
PART = {"width": "190px"}
PARTS = {  # of the recipe `quantile`: what each one sets
    "failsafe": ("failsafe",),
    "quantiles": ("quantiles", "huber_delta"),
    "advantage learning": ("advantage_learning",),
}


class TrainingLab(ipywidgets.VBox):
    """A small training run in the background, its curves, and how the agent flies.

    The flight is that after the newest validation; a click on the curves, or the slider, shows that
    after another one. A run pauses when the lab is closed, and when the process ends.

    Arguments:
        scenario, recipe: names of presets; `recipe` may also be a `Recipe`.
    """

    def __init__(self, scenario: str = "village", recipe: str | Recipe = "small"):
        self.scenario = find_scenario(scenario)
        self.recipe = find_recipe(recipe) if isinstance(recipe, str) else recipe
        number, wide = ipywidgets.FloatText, {"description_width": "140px"}
        self.settings = {
            "crash_reward": number(
                self.recipe.crash_reward, description="crash reward", style=wide
            ),
            "crash_reward_end": number(
                self.recipe.crash_reward_end, description="crash reward, end", style=wide
            ),
            "temperature": number(self.recipe.temperature, description="temperature", style=wide),
            "return_steps": ipywidgets.BoundedIntText(
                self.recipe.return_steps, min=1, max=20, description="return steps", style=wide
            ),
        }
        self.parts = {
            name: ipywidgets.Checkbox(description=name, indent=False, layout=PART) for name in PARTS
        }
        self.seed = ipywidgets.BoundedIntText(description="seed", min=0, max=10**6, style=wide)
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
        self.ax = figure.add_axes((0.12, 0.13, 0.83, 0.84))
        self.curves, self.stage = Canvas(figure), Stage()
        self.stage.layout = BESIDE
        self.looked_at = ipywidgets.IntSlider(
            max=0, description="flight at validation", style=wide, layout={"width": "480px"}
        )
        self.views = ipywidgets.HBox([self.curves.picture, self.stage], layout=WRAP)
        self.curves.on_click(lambda ax, steps, _: self.look_at(steps))
        super().__init__(
            [
                ipywidgets.HBox(
                    [
                        ipywidgets.VBox(list(self.settings.values())),
                        ipywidgets.VBox(list(self.parts.values())),
                        ipywidgets.VBox([self.seed, self.progress]),
                    ],
                    layout=WRAP,
                ),
                ipywidgets.HBox([self.start, self.pause, self.new_run]),
                self.status,
                self.looked_at,
                self.views,
            ]
        )
        self.looked_at.observe(lambda _: self._show_flight(), "value")
        self.start.on_click(lambda _: self.run())
        self.pause.on_click(lambda _: self.stop())
        self.new_run.on_click(lambda _: self.reset())
        self.trainer: Trainer | None = None
        self.previous: list[dict] = []  # validations of the previous run
        self.flown: list[Flights] = []  # the same mission after each validation
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
            self.trainer = self.trainer or self._new()
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
        if self.trainer is not None:
            self.trainer.close()
            self.previous = self.trainer.validation_rows
        self.trainer, self.progress.value, self.flown = None, 0, []
        self.looked_at.max = 0
        self.stage.layout.display = self.looked_at.layout.display = "none"
        self._draw_curves()
        self.curves.draw(alt="Curves of the previous run, if there was one")
        self._set_running(False)
        self._say("change the settings, then start")

    def close(self) -> None:
        """Pause the run for good and take the lab off the page."""
        self.stop()
        if self.trainer is not None:
            self.trainer.close()
        super().close()

    def _new(self) -> Trainer:
        changes = {name: setting.value for name, setting in self.settings.items()}
        source = find_recipe("quantile")
        for part, names in PARTS.items():
            if self.parts[part].value:
                changes |= {name: getattr(source, name) for name in names}
        trainer = Trainer(self.scenario, replace(self.recipe, **changes), self.seed.value)
        self.mission = Mission.draw(self.scenario, trainer.city, 0)
        trainer.validate()
        return trainer

    def _train(self) -> None:
        """In the thread: train until the run is paused or finished; show what goes wrong."""
        trainer, looked = self.trainer, 0.0
        interval = trainer.recipe.validation_interval
        try:
            self._show_agent()
            while not trainer.finished and not self._stop.is_set():
                before, started = trainer.steps, time.perf_counter()
                trainer.step()
                trainer.seconds += time.perf_counter() - started
                if trainer.steps // interval > before // interval or trainer.finished:
                    trainer.validate()
                    self._show_agent()
                if time.perf_counter() - looked > REFRESH:
                    looked = time.perf_counter()
                    self.progress.value = trainer.steps
            self.progress.value = min(trainer.steps, trainer.recipe.steps)
            self._say(f"{'finished' if trainer.finished else 'paused'}: {self._result()}")
        except Exception as error:  # whatever it is, the reader must see it
            self._say(f"{type(error).__name__}: {error}", error=True)
        finally:
            self._set_running(False)

    def _set_running(self, running: bool) -> None:
        done = self.trainer is not None and self.trainer.finished
        self.start.disabled, self.pause.disabled = running or done, not running
        self.new_run.disabled = running or self.trainer is None
        for setting in (*self.settings.values(), *self.parts.values(), self.seed):
            setting.disabled = self.trainer is not None

    def _show_agent(self) -> None:
        """Show the curves so far, and a flight of the agent as it is now."""
        trainer = self.trainer
        if len(self.flown) < len(trainer.validation_rows):  # not yet seen before a pause
            self.flown.append(self.mission.fly(trainer.environment, trainer.agent))
        last = len(self.flown) - 1
        with self._drawing:
            self.looked_at.max = last
            self.stage.layout.display = self.looked_at.layout.display = None
            self._draw_curves()
            if self.looked_at.value == last:
                self._show_flight()
            self.looked_at.value = last
            self._say(self._result())

    def look_at(self, steps: float) -> None:
        """Show the flight after the validation that is nearest to so many steps."""
        if self.flown:
            rows = self.trainer.validation_rows
            numbers = range(len(self.flown))
            self.looked_at.value = min(numbers, key=lambda k: abs(rows[k]["steps"] - steps))

    def _show_flight(self) -> None:
        """Play the flight of a validation, and mark it on the curves."""
        number = self.looked_at.value
        if number >= len(self.flown):  # a new run has none yet
            return
        steps = self.trainer.validation_rows[number]["steps"]
        name = f"the agent after {steps:,} steps"
        with self._drawing:
            self.stage.show(self.trainer.environment, {name: self.flown[number]}, begin=0)
            self._mark(steps)

    def _result(self) -> str:
        """How far the run is, with its last validation."""
        trainer, row = self.trainer, self.trainer.validation_rows[-1]
        return (
            f"after {trainer.steps:,} steps, {trainer.updates:,} updates, {trainer.seconds:.0f} s: "
            f"landed {row['has_landed']:.0%}, "
            f"collected and landed {row['collection_ratio_and_landed']:.0%}"
        )

    def _draw_curves(self) -> None:
        self.ax.clear()
        rows = self.trainer.validation_rows if self.trainer else []
        for metric, (label, colour) in CURVES.items():
            steps = [row["steps"] for row in rows]
            self.ax.plot(steps, [row[metric] for row in rows], "o-", color=colour, label=label)
            before = [(row["steps"], row[metric]) for row in self.previous]
            if before:
                self.ax.plot(*zip(*before, strict=True), ":", color=colour, alpha=0.6)
        self.ax.set(xlim=(0, self.recipe.steps), ylim=(-0.03, 1.03), xlabel="environment steps")
        self.ax.legend(loc="lower right", fontsize="small")
        self.curves.draw_all()

    def _mark(self, steps: int) -> None:
        """Mark the validation whose flight is shown."""
        line = self.ax.axvline(steps, color="black", lw=0.8, animated=True)
        self.curves.draw([(self.ax, line)], f"Curves of the validations; {self._result()}")
        line.remove()

    def _say(self, text: str, error: bool = False) -> None:
        self.status.value = status(text, RED if error else "inherit")


def _close(lab: weakref.ref) -> None:
    if (alive := lab()) is not None:
        alive.close()

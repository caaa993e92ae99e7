"""Training live: in the background, with pause, and with errors shown."""

import subprocess
import sys
import time
from dataclasses import asdict, replace

import pytest
import torch
from driving import tell

from uavdh_lite.beyond.recipes import BeyondRecipe
from uavdh_lite.labs import TrainingLab
from uavdh_lite.labs.training import CURVES, RIVAL, YOURS
from uavdh_lite.recipe import find_recipe

TINY = replace(
    BeyondRecipe(**asdict(find_recipe("small"))),
    steps=1600,
    kernels=2,
    hidden=(16,),
    batch_size=32,
    replay_capacity=1000,
    replay_prefill=160,
    validation_interval=400,
    validation_episodes=10,
)


def run(lab):
    lab.start.click()
    lab._thread.join(120)
    assert not lab._thread.is_alive()


def pause_early(lab):
    """Start, and pause once it has learned."""
    lab.start.click()
    while not lab.trainers[YOURS].updates:
        assert lab.running
        time.sleep(0.001)
    lab.pause.click()


def labels_of(lab):
    """The legend of the runs, without its line breaks."""
    legend = lab.ax.figure.legends[0]
    return [text.get_text().replace("\n", " ") for text in legend.get_texts()]


def measured(trainer):
    """Its validations without their times."""
    return [
        {name: value for name, value in row.items() if name != "seconds"}
        for row in trainer.validation_rows
    ]


@pytest.fixture
def lab():
    return TrainingLab("village", TINY)


@pytest.fixture
def finished():
    lab = TrainingLab("village", TINY)
    run(lab)
    return lab


def test_a_run_shows_curves_and_a_flight(finished):
    assert finished.progress.value == 1600 and "finished" in finished.status.value
    rows = finished.trainers[YOURS].validation_rows
    assert [row["steps"] for row in rows] == [0, 400, 800, 1200, 1600]
    assert list(finished.ax.lines[0].get_xdata()) == [0, 400, 800, 1200, 1600]
    assert finished.ax.get_xlim()[1] > 1600  # the last point is whole
    assert "Validation after 1,600 steps: your run landed" in finished.status.value
    assert "your run after 1,600 steps" in finished.stage.drawing
    assert finished._result() in finished.curves.picture.alt
    assert finished.start.disabled and not finished.new_run.disabled


def test_a_click_on_the_curves_shows_the_flight_at_that_time(finished):
    assert [len(finished.flown), finished.looked_at.value, finished.looked_at.max] == [5, 4, 4]
    newest = finished.curves.picture.value
    x, y = finished.ax.transData.transform((850, 0.5))
    tell(finished.curves.picture, kind="click", x=x, y=finished.curves.figure.bbox.height - y)
    assert finished.looked_at.value == 2 and "your run after 800 steps" in finished.stage.drawing
    assert finished.stage.begin == 0 and finished.curves.picture.value != newest
    finished.looked_at.value = 0
    assert "your run after 0 steps" in finished.stage.drawing
    finished.new_run.click()
    assert finished.looked_at.layout.display == finished.stage.layout.display == "none"
    finished.look_at(800)  # nothing to look at yet
    assert finished.flown == [] and finished.looked_at.max == 0


def test_parts_of_the_quantile_recipe_are_added_one_by_one(lab):
    source = find_recipe("quantile")
    assert lab._new()[YOURS].recipe == TINY
    lab.parts["failsafe"].value = True
    assert lab._new()[YOURS].recipe == replace(TINY, failsafe=True)
    lab.parts["quantiles"].value = lab.parts["advantage learning"].value = True
    changed = {"quantiles", "huber_delta", "advantage_learning"}
    changes = {name: getattr(source, name) for name in changed}
    assert lab._new()[YOURS].recipe == replace(TINY, failsafe=True, **changes)


def test_pausing_changes_nothing_of_the_result(lab, finished):
    pause_early(lab)
    assert 0 < lab.trainers[YOURS].steps < 1600 and "paused" in lab.status.value
    assert not lab.start.disabled and lab.stage.begin == -1  # the flights pause, too
    run(lab)
    ours, theirs = (each.trainers[YOURS].learner.online.state_dict() for each in (lab, finished))
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)
    assert len(lab.flown) == len(lab.trainers[YOURS].validation_rows)  # none twice


def test_the_run_before_is_named_by_its_changes(lab):
    lab.settings["return_steps"].value = 1
    lab.parts["failsafe"].value = True
    run(lab)
    lab.new_run.click()
    assert not lab.settings["return_steps"].disabled and lab.progress.value == 0
    lab.settings["return_steps"].value = TINY.return_steps
    lab.parts["failsafe"].value = False
    lab.trainers = lab._new()
    lab._draw_curves()
    assert labels_of(lab) == ["your run", "the run before: return steps 1, failsafe"]


def test_the_longest_legend_is_within_the_picture(lab):
    lab.race.value = True
    for settings in (lab.yours, lab.rival):
        settings.values["crash_reward"].value = settings.values["crash_reward_end"].value = -150
        settings.values["return_steps"].value = 1
        settings.values["temperature"].value = 0.5
        for part in settings.parts.values():
            part.value = True
    lab.trainers = lab._new()
    lab.new_run.disabled = False
    lab.new_run.click()
    assert list(lab.previous) == [YOURS, RIVAL] and lab.trainers == {}
    lab.trainers = lab._new()
    lab._draw_curves()
    assert len(lab.ax.lines) == 4 * len(CURVES) and len(labels_of(lab)) == 4
    figure = lab.ax.figure
    for legend in (figure.legends[0], lab.ax.get_legend()):
        box = legend.get_window_extent()
        assert box.x0 >= 0 and box.x1 <= figure.bbox.width
        assert box.y0 >= 0 and box.y1 <= figure.bbox.height
    assert figure.legends[0].get_window_extent().y1 < lab.ax.xaxis.label.get_window_extent().y0


def test_two_runs_race_and_each_learns_as_if_alone(lab, finished):
    lab.race.value = True
    assert lab.recipes.children == (lab.yours, lab.rival)
    lab.parts["failsafe"].value = True
    pause_early(lab)
    behind = lab.trainers[YOURS].steps - lab.trainers[RIVAL].steps
    assert behind in (0, TINY.environments)  # they take turns
    run(lab)
    recipes = {name: trainer.recipe for name, trainer in lab.trainers.items()}
    assert recipes == {YOURS: replace(TINY, failsafe=True), RIVAL: TINY}
    assert measured(lab.trainers[RIVAL]) == measured(finished.trainers[YOURS])
    assert [list(each) for each in lab.flown] == 5 * [[YOURS, RIVAL]]
    assert all(f"{name} after 1,600 steps" in lab.stage.drawing for name in (YOURS, RIVAL))
    assert "finished" in lab.status.value and f"{RIVAL} landed" in lab.status.value
    assert labels_of(lab) == ["your run: failsafe", "the rival"]
    held = [*lab.rival.values.values(), *lab.rival.parts.values(), lab.race, lab.seed]
    assert all(each.disabled for each in held)
    lab.new_run.click()
    assert not any(each.disabled for each in held) and lab.trainers == {}
    lab.rival.values["temperature"].value = -1
    lab.start.click()
    assert "the rival" in lab.status.value and "temperature is -1.0" in lab.status.value
    lab.race.value = False
    assert lab.recipes.children == (lab.yours,) and list(lab._new()) == [YOURS]


def test_errors_are_shown(lab):
    lab.settings["temperature"].value = -1
    lab.start.click()
    assert "temperature is -1.0" in lab.status.value and not lab.running
    lab.settings["temperature"].value = 1
    lab.trainers = lab._new()
    lab.trainers[YOURS].step = lambda: 1 / 0
    run(lab)
    assert "ZeroDivisionError" in lab.status.value and lab.pause.disabled


def test_the_kernel_stays_free_and_a_closed_lab_trains_no_more(lab):
    """While a run is on, other code runs: the call returns before the training ends."""
    lab.start.click()
    thread = lab._thread
    assert thread.is_alive() and not lab.trainers[YOURS].finished
    lab.close()
    assert not thread.is_alive() and not lab.trainers[YOURS].finished


def test_a_process_ends_properly_during_a_training():
    """A thread that goes on computing makes the interpreter abort (status −6 on Linux)."""
    code = (
        "import time; from uavdh_lite.labs import TrainingLab; lab = TrainingLab(); "
        "lab.start.click()\n"
        "while not lab.trainers['your run'].updates: time.sleep(0.01)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")

"""Training live: in the background, with pause, and with errors shown."""

import subprocess
import sys
import time
from dataclasses import replace

import pytest
import torch

from uavdh_lite.labs import TrainingLab
from uavdh_lite.labs.training import CURVES, RIVAL, YOURS
from uavdh_lite.recipe import find_recipe

TINY = replace(
    find_recipe("small"),
    steps=1600,
    kernels=2,
    hidden=(16,),
    batch_size=32,
    replay_capacity=1000,
    replay_prefill=160,
    validation_interval=400,
    validation_episodes=10,
)


def wait(lab):
    lab._thread.join(60)
    assert not lab._thread.is_alive()


@pytest.fixture
def finished():
    lab = TrainingLab("village", TINY)
    lab.start.click()
    wait(lab)
    return lab


def test_a_run_shows_curves_and_a_flight(finished):
    assert finished.progress.value == 1600 and "finished" in finished.status.value
    rows = finished.trainers[YOURS].validation_rows
    assert [row["steps"] for row in rows] == [0, 400, 800, 1200, 1600]
    drawn = finished.ax.lines[0].get_xdata()
    assert finished.ax.get_xlim()[1] > 1600  # the last point is whole
    assert finished.ax.get_ylabel() == "share of missions, or of their data"
    assert "Validation after 1,600 steps: your run landed" in finished.status.value
    assert list(drawn) == [0, 400, 800, 1200, 1600]
    assert "your run after 1,600 steps" in finished.stage.drawing
    assert finished._result() in finished.curves.picture.alt
    assert finished.start.disabled and not finished.new_run.disabled


def test_a_click_on_the_curves_shows_the_flight_at_that_time(finished):
    assert [len(finished.flown), finished.looked_at.value, finished.looked_at.max] == [5, 4, 4]
    newest = finished.curves.picture.value
    x, y = finished.ax.transData.transform((850, 0.5))
    told = {"kind": "click", "x": x, "y": finished.curves.figure.bbox.height - y}
    finished.curves.picture._handle_custom_msg(told, [])
    assert finished.looked_at.value == 2 and "your run after 800 steps" in finished.stage.drawing
    assert finished.stage.begin == 0 and finished.curves.picture.value != newest
    finished.looked_at.value = 0
    assert "your run after 0 steps" in finished.stage.drawing
    finished.new_run.click()
    assert finished.looked_at.layout.display == finished.stage.layout.display == "none"
    finished.look_at(800)  # nothing to look at yet
    assert finished.flown == [] and finished.looked_at.max == 0


def test_parts_of_the_quantile_recipe_are_added_one_by_one():
    lab, source = TrainingLab("village", TINY), find_recipe("quantile")
    assert lab._new()[YOURS].recipe == replace(
        TINY, **{k: v.value for k, v in lab.settings.items()}
    )
    lab.parts["failsafe"].value = True
    assert lab._new()[YOURS].recipe == replace(TINY, failsafe=True)
    lab.parts["quantiles"].value = lab.parts["advantage learning"].value = True
    recipe = lab._new()[YOURS].recipe
    assert (recipe.quantiles, recipe.huber_delta) == (source.quantiles, source.huber_delta)
    assert recipe.advantage_learning == source.advantage_learning and recipe.failsafe


def test_pausing_changes_nothing_of_the_result(finished):
    lab = TrainingLab("village", TINY)
    lab.start.click()
    while not lab.trainers[YOURS].updates:
        time.sleep(0.001)
    lab.pause.click()
    steps = lab.trainers[YOURS].steps
    assert 0 < steps < 1600 and "paused" in lab.status.value and not lab.start.disabled
    assert lab.stage.begin == -1  # the flights pause, too
    lab.start.click()
    wait(lab)
    ours, theirs = (each.trainers[YOURS].learner.online.state_dict() for each in (lab, finished))
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)
    assert len(lab.flown) == len(lab.trainers[YOURS].validation_rows)  # none twice


def test_the_run_before_is_named_by_its_changes(finished):
    lab = TrainingLab("village", TINY)
    lab.settings["return_steps"].value = 1
    lab.parts["failsafe"].value = True
    lab.start.click()
    wait(lab)
    lab.new_run.click()
    lab.trainers = finished.trainers
    lab._draw_curves()
    assert labels_of(lab) == ["your run", "the run before: failsafe, return steps 1"]


def labels_of(lab):
    """The legend of the runs, without its line breaks."""
    legend = lab.ax.figure.legends[0]
    return [text.get_text().replace("\n", " ") for text in legend.get_texts()]


def test_a_new_run_keeps_the_curves_of_both_and_the_longest_legend_is_within_the_picture(finished):
    lab = TrainingLab("village", TINY)
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
    assert sorted({line.get_linestyle() for line in lab.ax.lines}) == ["-.", ":"]
    lab.trainers = lab._new()
    lab._draw_curves()
    before = (
        "before: failsafe, quantiles, return steps 1, advantage learning, temperature 0.5, "
        "crash reward -150, crash reward at the end -150"
    )
    assert sorted(labels_of(lab)[2:]) == [f"the rival {before}", f"the run {before}"]
    assert len(lab.ax.lines) == 4 * len(CURVES)
    figure = lab.ax.figure
    for legend in (figure.legends[0], lab.ax.get_legend()):
        box = legend.get_window_extent()
        assert box.x0 >= 0 and box.x1 <= figure.bbox.width
        assert box.y0 >= 0 and box.y1 <= figure.bbox.height
    assert figure.legends[0].get_window_extent().y1 < lab.ax.xaxis.label.get_window_extent().y0


def test_the_recipe_races_the_run_with_changes_and_each_learns_as_if_alone(finished):
    lab = TrainingLab("village", TINY)
    lab.race.value = True
    lab.settings["return_steps"].value = 1
    lab.start.click()
    while not lab.trainers[YOURS].updates:
        time.sleep(0.001)
    lab.pause.click()
    behind = lab.trainers[YOURS].steps - lab.trainers[RIVAL].steps
    assert behind in (0, TINY.environments)  # they take turns
    lab.start.click()
    wait(lab)
    recipes = {name: trainer.recipe for name, trainer in lab.trainers.items()}
    assert recipes == {YOURS: replace(TINY, return_steps=1), RIVAL: TINY}
    alone = finished.trainers[YOURS].validation_rows
    measured = [name for name in alone[0] if name != "seconds"]
    rival = lab.trainers[RIVAL].validation_rows
    assert [[row[m] for m in measured] for row in rival] == [
        [row[m] for m in measured] for row in alone
    ]
    assert [list(each) for each in lab.flown] == 5 * [[YOURS, RIVAL]]
    assert all(f"{name} after 1,600 steps" in lab.stage.drawing for name in (YOURS, RIVAL))
    assert "finished" in lab.status.value and f"{RIVAL} landed" in lab.status.value
    dashed = [
        line for line in lab.ax.lines if line.get_linestyle() == "--" and len(line.get_xdata())
    ]
    assert [len(line.get_xdata()) for line in dashed] == [5, 5, 5]
    lab.new_run.click()
    assert not lab.race.disabled and lab.trainers == {}


def test_any_two_recipes_race():
    lab = TrainingLab("village", TINY)
    assert lab.recipes.children == (lab.yours,)
    lab.race.value = True
    assert lab.recipes.children == (lab.yours, lab.rival)
    lab.parts["failsafe"].value = True
    lab.rival.values["return_steps"].value = 1
    lab.rival.parts["quantiles"].value = True
    lab.start.click()
    wait(lab)
    recipes = {name: trainer.recipe for name, trainer in lab.trainers.items()}
    source = find_recipe("quantile")
    assert recipes == {
        YOURS: replace(TINY, failsafe=True),
        RIVAL: replace(
            TINY, return_steps=1, quantiles=source.quantiles, huber_delta=source.huber_delta
        ),
    }
    assert labels_of(lab) == ["your run: failsafe", "the rival: quantiles, return steps 1"]
    assert f"{RIVAL} after 1,600 steps" in lab.stage.drawing
    held = [*lab.rival.values.values(), *lab.rival.parts.values(), lab.race, lab.seed]
    assert all(each.disabled for each in held) and "press new run" in lab.status.value
    lab.new_run.click()
    assert not any(each.disabled for each in held)
    lab.rival.values["temperature"].value = -1
    lab.start.click()
    assert "the rival" in lab.status.value and not lab.running
    assert "temperature is -1.0, must be above 0" in lab.status.value
    lab.race.value = False
    assert lab.recipes.children == (lab.yours,) and list(lab._new()) == [YOURS]


def test_settings_are_taken_and_held_while_a_run_is_on(finished):
    assert finished.settings["temperature"].disabled
    finished.new_run.click()
    assert not finished.settings["temperature"].disabled and finished.progress.value == 0
    finished.settings["return_steps"].value = 1
    finished.start.click()
    wait(finished)
    assert finished.trainers[YOURS].recipe.return_steps == 1


def test_errors_are_shown():
    lab = TrainingLab("village", TINY)
    lab.settings["temperature"].value = -1
    lab.start.click()
    assert "temperature is -1.0, must be above 0" in lab.status.value
    lab.settings["temperature"].value = 1
    lab.trainers = lab._new()
    lab.trainers[YOURS].step = lambda: 1 / 0
    lab.start.click()
    wait(lab)
    assert "ZeroDivisionError" in lab.status.value and lab.pause.disabled


def test_the_kernel_stays_free(finished):
    """While a run is on, other code runs: the call returns before the training ends."""
    finished.new_run.click()
    finished.start.click()
    assert finished._thread.is_alive() and not finished.trainers[YOURS].finished
    finished.pause.click()


def test_a_closed_lab_trains_no_more(finished):
    finished.new_run.click()
    finished.start.click()
    thread = finished._thread
    finished.close()
    assert not thread.is_alive() and not finished.trainers[YOURS].finished


def test_a_process_ends_properly_during_a_training():
    """A thread that goes on computing makes the interpreter abort (status −6 on Linux)."""
    code = (
        "import time; from uavdh_lite.labs import TrainingLab; lab = TrainingLab(); "
        "lab.start.click()\n"
        "while not lab.trainers['your run'].updates: time.sleep(0.01)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")

"""A small city and quick recipes that several tests share."""

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
import pytest

from uavdh_lite.city import City
from uavdh_lite.scenario import Scenario

if TYPE_CHECKING:  # the process that hands out the tests needs no torch
    from uavdh_lite.recipe import Recipe
    from uavdh_lite.training import Trainer

matplotlib.use("Agg")
# Every core has a worker already. Processes and kernels that tests start inherit this.
os.environ.setdefault("OMP_NUM_THREADS", "1")

LONGEST = (  # they begin first, so that none of them is left over at the end
    "test_site", "test_how_to", "08_ablation_map_centring", "07_training", "09_finale",
    "test_challenge", "test_study", "project", "test_page", "test_mutants", "11_replay",
    "test_world", "test_session", "test_cli", "06_ddqn", "test_learning",
)  # fmt: skip


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config) -> int:
    """One worker more than cores: browsers, servers and time limits leave their core idle."""
    return os.cpu_count() + 1


def pytest_collection_modifyitems(items):
    """Of some notebooks others run the code: `test_solutions.py`, and the project's template.

    Those that go further than the course are run by CI. So are those that train for long, once a
    week; at other times `test_notebooks.py` runs their code with fewer steps.
    """
    place = {stem: place for place, stem in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(place)))
    for item in items:
        stem, trains = item.path.stem, ("07_training", "08_ablation_map_centring", "09_finale")
        if "solutions" in item.path.parts or stem.startswith("example_") or stem in trains:
            item.add_marker("long")
            item.add_marker("longest")
        elif item.path.suffix == ".ipynb" and stem >= "07":
            item.add_marker("long")


@pytest.fixture(scope="module")
def browser():
    """Chromium. Without it, tests that need it are skipped."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        own = playwright.chromium.executable_path
        chromium = os.environ.get("CHROMIUM") or shutil.which("chromium") or own
        if not Path(chromium).exists():
            pytest.skip("no Chromium: name one in CHROMIUM")
        yield playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])


CORRIDOR = """
B B B B B
B B B B B
L . . . .
B B B B B
B B B B B
"""


@pytest.fixture(scope="session")
def corridor() -> City:
    """One street: land at its west end, devices anywhere else in it."""
    return City.from_text("corridor", CORRIDOR)


@pytest.fixture(scope="session")
def corridor_scenario() -> Scenario:
    return Scenario("corridor", "corridor", (1, 1), (5.0, 10.0), (14, 20))


@pytest.fixture(scope="session")
def quick() -> "Recipe":
    """`lite` with a small network, a short run and what else a recipe can have."""
    from uavdh_lite.recipe import LITE

    return replace(
        LITE,
        name="quick",
        steps=4_000,
        kernels=4,
        kernel_size=3,
        hidden=(32,),
        batch_size=32,
        strides=(2, 2),
        learning_rate=3e-4,
        environments=16,
        replay_capacity=2_000,
        replay_prefill=200,
        temperature=2.0,
        temperature_end=0.1,
        exploring_starts=0.5,
        amsgrad=False,
        crash_reward=-40.0,
        crash_reward_end=-40.0,
        validation_interval=1_000,
        validation_episodes=50,
    )


@pytest.fixture
def trainer(corridor: City, corridor_scenario: Scenario, quick) -> "Callable[..., Trainer]":
    """A function that begins a quick run; it takes a seed and changes of the recipe."""
    from uavdh_lite.training import Trainer

    return lambda seed=0, **changes: Trainer(
        corridor_scenario, replace(quick, **changes), seed, corridor
    )


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(0)

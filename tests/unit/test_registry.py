import subprocess
import sys
from types import SimpleNamespace

import pytest

from uavdh_lite import registry
from uavdh_lite.errors import InputError
from uavdh_lite.recipe import SMALL, Recipe
from uavdh_lite.scenario import find_scenario

VILLAGE = find_scenario("village")
RIGHT = {
    "recipe": SMALL,
    "recipe kind": Recipe,
    "scenario": VILLAGE,
    "policy": lambda environment, seed: None,
    "cities": lambda name: (),
}


@pytest.fixture
def extensions(monkeypatch):
    """A function that installs extensions, each a function to be called when it is loaded."""
    for kind in RIGHT:
        registry.names(kind)  # ours are imported
    known = {kind: dict(things) for kind, things in registry._known.items()}
    monkeypatch.setattr(registry, "_known", known)
    monkeypatch.setattr(registry, "_load", registry._load.__wrapped__)

    def install(**loads):
        found = [
            SimpleNamespace(name=name, value=f"package_of_{name}", load=load)
            for name, load in loads.items()
        ]
        monkeypatch.setattr(registry, "entry_points", lambda group: found)

    return install


def test_an_extension_is_loaded_when_a_name_is_looked_up(extensions):
    extensions(mine=lambda: registry.register("recipe", "mine", SMALL))
    assert registry.find("recipe", "mine") is SMALL
    assert registry.names("recipe")[-1] == "mine" and "mine" not in registry.names("scenario")
    with pytest.raises(InputError, match=r"recipe 'yours'.*mine"):
        registry.find("recipe", "yours")


def test_an_extension_that_fails_is_named_and_the_others_work(extensions):
    extensions(
        broken=lambda: 1 / 0,
        wrong=lambda: registry.register("recipe", "small", None),
        mine=lambda: registry.register("scenario", "mine", VILLAGE),
    )
    with pytest.warns(UserWarning) as warned:
        assert registry.find("scenario", "mine") is VILLAGE
    broken, wrong = (str(each.message) for each in warned)
    assert all(part in broken for part in ("broken", "package_of_broken", "division by zero"))
    assert "extension wrong" in wrong and "recipe 'small': must be a Recipe" in wrong
    with pytest.warns(UserWarning):
        assert registry.find("recipe", "small") is SMALL


@pytest.mark.parametrize("kind", RIGHT)
def test_what_is_registered_is_of_its_kind(kind, extensions):
    registry.register(kind, "mine", RIGHT[kind])
    for wrong in (None, 42, "small", *RIGHT.values()):
        a_function = callable(wrong) and callable(RIGHT[kind])
        if wrong is RIGHT[kind] or (kind in ("policy", "cities") and a_function):
            continue
        with pytest.raises(InputError, match=rf"{kind} 'wrong': must be a"):
            registry.register(kind, "wrong", wrong)
    with pytest.raises(InputError, match=r"kind 'city'.*cities"):
        registry.register("city", "mine", 42)


def test_what_is_beyond_the_paper_is_known_by_name():
    assert {"paper", "plain", "lite", "small", "told", "imitation"} <= set(registry.names("recipe"))
    assert "any_city" in registry.names("scenario") and "random" in registry.names("cities")
    assert {"greedy", "random", "genie"} == set(registry.names("policy"))


WORLD = """
import sys
from uavdh_lite import missions, registry
from uavdh_lite.beyond.genie import Genie
from uavdh_lite.city import load_cities, load_city
from uavdh_lite.environment import Environment
from uavdh_lite.evaluation import evaluate
from uavdh_lite.planners import Greedy
from uavdh_lite.scenario import find_scenario

scenario = find_scenario("village")
assert find_scenario("any_city").city.startswith("random") and registry.names("policy")
environment = Environment(load_city(scenario.city))
for policy in (Greedy(environment), Genie(environment), registry.find("policy", "random")(None, 0)):
    assert evaluate(environment, policy, scenario, 2, seed=0).metrics()
mission = missions.Mission.draw(scenario, load_cities("random:1:0")[0], 0)
assert missions.mission_from_json(missions.as_json(mission)).flying_time
print(*{"torch", "matplotlib", "gymnasium"}.intersection(sys.modules))
"""


def test_scenarios_planners_and_missions_load_no_torch():
    """In a process of its own: here torch is loaded already."""
    done = subprocess.run([sys.executable, "-c", WORLD], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.strip() == "", done.stdout + done.stderr

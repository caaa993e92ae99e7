import subprocess
import sys

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


EXTENSION = """
from uavdh_lite import registry, scenario

registry.register("scenario", "mine", scenario.Scenario("mine"))
"""


def test_extensions_are_found_by_name_and_one_that_fails_is_left_out(tmp_path):
    about = tmp_path / "more-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Name: more\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[uavdh_lite.scenario]\nbad = less\nmine = more\n")
    (tmp_path / "less.py").write_text("1 / 0")
    (tmp_path / "more.py").write_text(EXTENSION)
    program = f"import sys; sys.path.append({str(tmp_path)!r}); from uavdh_lite import scenario\n"
    program += "print(scenario.find_scenario('mine').name)\nscenario.find_scenario('yours')"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "mine\n" and "unknown scenario 'yours': choose one of" in done.stderr
    assert "extension bad (less) is left out, because it fails with ZeroDiv" in done.stderr


@pytest.mark.parametrize("kind", RIGHT)
def test_what_is_registered_is_of_its_kind(kind):
    for wrong in (None, 42, "small", *RIGHT.values()):
        if wrong is not RIGHT[kind] and not (callable(wrong) and callable(RIGHT[kind])):
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

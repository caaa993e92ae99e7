import subprocess
import sys

import pytest

from uavdh_lite import registry
from uavdh_lite.errors import InputError
from uavdh_lite.scenario import find_scenario

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
    assert "extension less is left out: ZeroDivisionError" in done.stderr


def test_what_has_another_name_of_its_own_is_not_registered():
    """Files would keep that name, under which another is found."""
    with pytest.raises(InputError, match="scenario hard: its own name is 'village'"):
        registry.register("scenario", "hard", find_scenario("village"))


def test_what_is_beyond_the_paper_is_known_by_name():
    assert {"paper", "plain", "lite", "small", "told", "imitation"} <= set(registry.names("recipe"))
    assert "any_city" in registry.names("scenario") and "random" in registry.names("cities")
    assert {"greedy", "random", "genie"} == set(registry.names("policy"))


WORLD = """
import sys
from uavdh_lite import missions, registry
from uavdh_lite.city import load_cities
from uavdh_lite.environment import Environment
from uavdh_lite.scenario import find_scenario

assert find_scenario("any_city").city.startswith("random")
city, = load_cities("random:1:0")
policy = registry.find("policy", "genie")(Environment(city), 0)
missions.Mission.draw(find_scenario("village"), city, 0).fly(Environment(city), policy)
print(*{"torch", "matplotlib", "gymnasium"}.intersection(sys.modules))
"""


def test_scenarios_planners_and_missions_load_no_torch():
    """In a process of its own: here torch is loaded already."""
    done = subprocess.run([sys.executable, "-c", WORLD], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.strip() == "", done.stdout + done.stderr

"""Whatever is written into a field of a configuration: it is refused by its name, or it works."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.channel import Channel
from uavdh_lite.city import City
from uavdh_lite.config import from_json
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import FunctionPolicy, fly
from uavdh_lite.missions import Mission, as_json, mission_from_json
from uavdh_lite.observation import Observation
from uavdh_lite.recipe import recipe_from_json
from uavdh_lite.registry import find, names
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream

VILLAGE, MANHATTAN = Environment(City.load("village")), City.load("manhattan")
SCHEDULES = "temperature", "training_rewards", "learning_rate"
ODD = [None, True, "", "x", "\ud800", "\0", b"x", [], [None], ["a"], (1, 2, 3), (2, 1), (1.5, 2.5)]
ODD += [{}, {"a": 1}, object(), np.array([1.5, 2]), 1j, -1, 0, 1, 1.5, -1e-3, 1e-50, 1e-300, 1e300]
ODD += [(1e-50, 1e-50), (0.0, 1e-40), (-1, 5), (1, 10**30), [[1, 2], [3, 4]], 2**63, -(2**63)]
ODD += [10**30, 10**400, math.nan, math.inf, -math.inf, (math.nan, 5), (1, math.inf), range(2)]


def flown(environment, scenario):
    """A few episodes flown at random; nothing in them may be other than finite."""
    start = scenario.sample(environment, 20, stream(Use.TEST))
    policy = FunctionPolicy(lambda state: np.arange(len(state)) % 6)
    flights = fly(environment, policy, start, stream(Use.TEST))
    assert all(np.isfinite(values).all() for values in flights.records().values())


def of_channel(field, value):
    with np.errstate(over="ignore"):  # a rate may be without end; no more is taken than there is
        flown(Environment(VILLAGE.city, Channel(**{field: value})), Scenario("s"))


def of_scenario(field, value):
    scenario = Scenario(**{"name": "s", "flying_time": (5, 9), field: value})
    assert from_json(Scenario, vars(scenario), "scenario") == scenario
    flown(VILLAGE, scenario)


def of_mission(field, value):
    given = Mission(VILLAGE.city, (0, 0), ((4, 1), (0, 7)), (15.0, 3.0), 24)
    mission = replace(given, **{field: value})
    assert mission_from_json(as_json(mission)).state.time_left == mission.flying_time
    flights = mission.fly(VILLAGE, FunctionPolicy(lambda state: np.full(len(state), 5)))
    assert all(np.isfinite(values).all() for values in flights.records().values())


def of_recipe(field, value):
    for name in names("recipe"):
        recipe = replace(find("recipe", name), **{field: value})
        assert recipe_from_json(recipe.as_json()) == recipe
        with torch.device("meta"):
            recipe.network_for(recipe.observation_for(recipe.environment_for(MANHATTAN)))
        done = [0, recipe.steps // 2, recipe.steps]
        values = [getattr(recipe, f"{f}_at")(s) for s in done for f in SCHEDULES]
        assert np.isfinite([v if isinstance(v, float) else v.crash for v in values]).all()


def of_cities(field, value):
    CityGenerator(**{"size": 16, field: value}).draw(1, 0)


def of_observation(field, value):
    Observation(**{"environment": VILLAGE, field: value})


OTHERWISE = {  # what an error may say in place of the field's name
    "kernel_size": ["kernels", "map"],
    "strides": ["map"],
    "max_devices": ["places", "1 to 1"],
    "kind": ["unknown observation"],
    "start": ["uav"],
}
RECIPE = {f.name for name in names("recipe") for f in fields(find("recipe", name))} - {"name"}
FIELDS = [
    *((of_channel, f.name) for f in fields(Channel)),
    *((of_scenario, f.name) for f in fields(Scenario) if f.name != "city"),  # read by `load_cities`
    *((of_mission, f.name) for f in fields(Mission)),
    *((of_recipe, name) for name in sorted(RECIPE)),
    *((of_cities, f.name) for f in fields(CityGenerator)),
    *((of_observation, name) for name in ("environment", "kind", "size")),
]


@pytest.mark.parametrize(("use", "field"), FIELDS, ids=lambda one: getattr(one, "__name__", one))
def test_an_odd_value_is_refused_by_its_name_or_works(use, field):
    refused = 0
    for value in ODD:
        try:
            use(field, value)
        except InputError as error:
            refused += 1
            assert len(str(error)) < 300, value
            known = field.replace("_", " "), field, field.rstrip("s"), *OTHERWISE.get(field, ())
            assert any(word in str(error).lower() for word in known), (value, str(error))
        except TypeError as error:  # a field of another recipe
            assert use is of_recipe and "unexpected keyword" in str(error)
            return
    assert refused > len(ODD) / 4

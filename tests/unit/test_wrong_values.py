"""What cannot be used is refused where it comes in, by an error that names it."""

from dataclasses import replace

import numpy as np
import pytest

from uavdh_lite.beyond.cities import CityGenerator
from uavdh_lite.beyond.genie import Genie
from uavdh_lite.beyond.measured import MeasuredEnvironment
from uavdh_lite.beyond.recipes import IMITATION, TOLD
from uavdh_lite.bridges.footprints import Raster
from uavdh_lite.channel import Channel
from uavdh_lite.city import MAX_SIZE, City, load_cities
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError
from uavdh_lite.evaluation import FunctionPolicy, mean_interval
from uavdh_lite.missions import Mission
from uavdh_lite.network import QNetwork
from uavdh_lite.observation import Observation
from uavdh_lite.policies import find_policy
from uavdh_lite.recipe import PAPER, recipe_from_json
from uavdh_lite.scenario import Scenario
from uavdh_lite.streams import Use, stream
from uavdh_lite.training import Trainer

VILLAGE = City.load("village")
WORLD, OPEN = Environment(VILLAGE), City.from_text("open", "L.\n..")
NONE, EYE = np.zeros((3, 3), bool), np.eye(3, dtype=bool)
ONE = {"start": (0, 0), "devices": [(4, 1), (0, 7)], "data": [10.0, 5.0], "flying_time": 40}


def scenario(**changes):
    return Scenario("mine", **changes)


def mission(**changes):
    return Mission(**{"city": VILLAGE, **ONE, **changes})


def step(*actions):
    start = scenario().sample(WORLD, 3, stream(Use.TEST))
    return WORLD.step(start, np.array(actions), stream(Use.FADING))


def sample(world, **changes):
    return scenario(**changes).sample(world, 1, stream(Use.TEST))


WRONG = [
    (lambda: Channel(slots=-1), "slots"),
    (lambda: City("both", EYE, EYE, NONE), "row 0, column 0 is landing zone and no-fly"),
    (lambda: City("odd", EYE, NONE, np.zeros((4, 4), bool)), "differ in shape"),
    (lambda: City("large", *np.zeros((3, MAX_SIZE + 1, MAX_SIZE + 1), bool)), "at most 100 fit"),
    (lambda: City.from_kinds("mine", np.array([[3, 5], [0, 0]])), "mine: kinds must be"),
    (lambda: City.from_text("mine", "\ufeff"), "mine: no rows"),  # with the mark of Windows
    (lambda: Environment("manhattan"), "takes a City .* here is 'manhattan': City.load"),
    (lambda: Environment((VILLAGE, "village")), "here is 'village'"),
    (lambda: Environment(()), "0 cities: an environment takes 1 to"),
    (lambda: step(0, 5, 6), "6 of episode 2"),
    (lambda: step(0, -1, 0), "-1 of episode 1"),
    (lambda: step(4.9, 4.9, 4.9), "4.9 of episode 0"),
    (lambda: step("north", "up", "up"), "action north of episode 0"),
    (lambda: step(0, 1), r"shape \(2,\)"),
    (lambda: mean_interval([]), "no values"),
    (lambda: mean_interval(np.array([]), np.array([])), "no values"),
    (lambda: FunctionPolicy(lambda state: np.full(1, 6)).act(sample(WORLD)), "6 of episode 0"),
    (lambda: scenario(devices=(0, 2)), "scenario mine: devices is"),
    (lambda: scenario(devices=(1, 101)), "scenario mine: devices is .* at most 100"),
    (lambda: scenario(devices=(3, 2)), "scenario mine: devices from 3 to 2"),
    (lambda: scenario(data=(0.0, 0.0)), "scenario mine: data from 0.0 to 0.0"),
    (lambda: scenario(data=(0.0, 0.05)), "scenario mine: data from 0.0 to 0.05"),
    (lambda: scenario(flying_time=(10, 40_000)), "scenario mine: flying_time is .* at most 32767"),
    (lambda: sample(Environment((OPEN, VILLAGE)), devices=(1, 5)), "5 devices, but open has 3"),
    (lambda: Observation(WORLD, "polar"), "'polar': choose centred or non_centred"),
    (lambda: QNetwork((5, 9, 9), kernel_size=10), "9×9 cells is too small"),
    (lambda: replace(PAPER, discount=1.5), "recipe paper: discount is 1.5, must be"),
    (lambda: replace(PAPER, environments=129), "environments is 129, must be at most batch_size"),
    (lambda: replace(PAPER, batch_size=25_001), "batch_size is 25001, must be"),
    (lambda: replace(PAPER, replay_prefill=50_001), "replay_prefill is 50001, must be"),
    (lambda: replace(PAPER, steps=20_000), "replay_prefill is 25000, must be at most steps"),
    (lambda: recipe_from_json({"kind": []}), "unknown recipe kind"),
    (lambda: recipe_from_json({"kind": "Recipe"}), "missing .*'name'"),
    (lambda: Trainer("village", PAPER, 0), "is a Scenario, here is 'village': find_scenario"),
    (lambda: Trainer(scenario(), "lite", 0), "is a Recipe, here is 'lite': find_recipe"),
    (lambda: Trainer(scenario(), IMITATION, 0), "trained by Reinforced, here is Trainer"),
    (lambda: find_policy("magic", WORLD), r"magic.*greedy"),
    (lambda: find_policy("manhattan", WORLD), r"manhattan.*village.*any_city"),
    (lambda: mission(start=(0, 8)), r"UAV .*\(0, 8\)"),
    (lambda: mission(start=(1, 4)), r"UAV .*\(1, 4\).*a building"),
    (lambda: mission(devices=[(4, 1), (16, 0)]), r"device 1 .*\(16, 0\)"),
    (lambda: mission(devices=[(0, 0), (4, 1)]), r"device 0 .*\(0, 0\).*landing zone"),
    (lambda: mission(devices=[(4, 1), (4, 1)]), r"device 1 .*\(4, 1\).*another device"),
    (lambda: mission(devices=[], data=[]), "0 devices"),
    (lambda: mission(max_devices=1), "2 devices"),
    (lambda: mission(max_devices=101), "max_devices is 101, must be at least 1 and at most 100"),
    (lambda: mission(data=[1.0]), "2 devices but 1"),
    (lambda: mission(data=[1.0, -1.0]), "device 1 has -1.0"),
    (lambda: mission(data=[np.nan, 1.0]), "device 0 has nan"),
    (lambda: mission(data=[0.0, 0.0]), "no device has data"),
    (lambda: mission(city="manhattan"), "city is 'manhattan', must be City"),
    (lambda: mission(flying_time=2**15), "flying time 32768"),
    (lambda: mission(seed=-1), "seed"),
    (lambda: mission().fill(2, 1.0), "no device 2: there are 0 to 1"),
    (lambda: load_cities("random:3:x"), "random:3:x: write random:COUNT:SEED"),
    (lambda: load_cities("random:1:2:8-"), "random:1:2:8-: write random:COUNT:SEED"),
    (lambda: load_cities("random:0:1"), "0 cities"),
    (lambda: load_cities("random:1:2:101"), "size is 101"),
    (lambda: load_cities("random:1:2:12-9"), "12 to 9"),
    (lambda: CityGenerator(kinds=()), "blocks, scattered, courtyards, old_town"),
    (lambda: CityGenerator(kinds=("castle",)), "blocks, scattered, courtyards, old_town"),
    (lambda: replace(TOLD, observation="non_centred"), "pooling needs"),
    (lambda: replace(TOLD, local_size=4), "pooling needs"),
    (lambda: MeasuredEnvironment(VILLAGE, mean_snr_db=NONE), "a table of 3 × 3 for 1 cities"),
    (lambda: Genie(WORLD).act(sample(WORLD, devices=(17, 17))), "17 devices .*at most 16.*greedy"),
    (lambda: Raster(assumed_m=-1.0), "assumed_m"),
]


@pytest.mark.parametrize(("make", "named"), WRONG, ids=[named for _, named in WRONG])
def test_it_is_refused_by_name(make, named):
    with pytest.raises(InputError, match=named):
        make()

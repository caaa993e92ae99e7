import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from uavdh_lite.beyond.cities import LEAST_BUILT, CityGenerator
from uavdh_lite.city import fingerprint_of, load_cities

DEFAULT = CityGenerator()


def zones(mask):
    """The number of connected parts."""
    left, count = {tuple(cell) for cell in np.argwhere(mask)}, 0
    while left:
        todo, count = [left.pop()], count + 1
        while todo:
            row, col = todo.pop()
            near = {(row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)} & left
            left -= near
            todo += near
    return count


@given(st.integers(8, 40), st.integers(0, 2**40), st.sampled_from(DEFAULT.kinds))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_cities_of_any_size_are_cities_in_which_the_uav_gets_everywhere(size, seed, kind):
    (city,) = CityGenerator(size, (kind,), smallest=size).draw(1, seed)
    assert city.size == size and city.name == f"{kind}_{seed}_0"
    assert zones(~city.no_fly) == 1 and 1 <= zones(city.landing) <= 3
    assert city.buildings.mean() >= LEAST_BUILT and city.open_to_devices.sum() >= 10


def test_a_seed_names_its_cities_for_good_and_more_of_them_begin_with_the_same():
    """Recorded results and the shipped agent rest on these names."""
    first, more = DEFAULT.draw(5, 3), load_cities("random:8:3")
    assert [city.text for city in first] == [city.text for city in more[:5]]
    assert [city.name for city in first] == [city.name for city in more[:5]]
    assert len({city.fingerprint for city in DEFAULT.draw(60, 0)}) == 60
    assert fingerprint_of(load_cities("random:20:1")).startswith("6950e71aeb1f4052")
    assert fingerprint_of(load_cities("random:20:1:24")).startswith("93f7c7dbe50ef283")


def test_every_other_city_may_be_smaller():
    sizes = [city.size for city in load_cities("random:200:4:8-12")]
    assert min(sizes) == 8 and max(sizes) == 12 and 90 < sizes.count(12) < 150

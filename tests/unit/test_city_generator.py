import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uavdh_lite.city import KINDS, City
from uavdh_lite.city_generator import LEAST_BUILT, CityGenerator, load_city
from uavdh_lite.errors import CityError, InputError

DEFAULT = CityGenerator()


def zones(mask):
    """The number of connected parts."""
    left, count = {tuple(cell) for cell in np.argwhere(mask)}, 0
    while left:
        todo, count = [left.pop()], count + 1
        while todo:
            row, col = todo.pop()
            for cell in ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)):
                if cell in left:
                    left.remove(cell)
                    todo.append(cell)
    return count


@given(st.integers(8, 40), st.integers(0, 2**40), st.sampled_from(DEFAULT.kinds))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_cities_of_any_size_are_valid_and_connected(size, seed, kind):
    (city,) = CityGenerator((size, size), kinds=(kind,)).draw(1, seed).cities
    assert city.size == size and city.name.startswith(kind)
    assert (city.landing_distance[~city.no_fly] >= 0).all(), "a cell that no way leads to"
    assert zones(~city.no_fly) == 1, "two landing zones that no way connects"
    assert 1 <= zones(city.landing) <= 3
    assert city.buildings.mean() >= LEAST_BUILT
    assert len(city.device_cells) >= 10


@given(
    st.integers(0, 2**40),
    st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted).map(tuple),
    st.integers(1, 3),
    st.floats(0, 1),
)
@settings(derandomize=True, deadline=None, max_examples=30)
def test_parameters_are_kept(seed, low_share, landing_zones, open_land):
    generator = CityGenerator(
        low_share=low_share,
        no_fly_zones=(0, 0),
        landing_zones=(landing_zones, landing_zones),
        open_land=open_land,
    )
    (city,) = generator.draw(1, seed).cities
    assert zones(city.landing) == landing_zones
    assert not (city.no_fly & ~city.buildings).any(), "a no-fly zone that was not asked for"
    if low_share == (0, 0):
        assert (city.no_fly == city.buildings).all()


def test_open_land_is_a_side_without_buildings():
    def empty_side(city):
        depth = city.size // 4
        return any(not np.rot90(city.buildings, turn)[:depth].any() for turn in range(4))

    kinds = ("blocks",)
    built = CityGenerator(kinds=kinds, open_land=0.0, no_fly_zones=(0, 0)).draw(10, 0)
    opened = CityGenerator(kinds=kinds, open_land=1.0, no_fly_zones=(0, 0)).draw(10, 0)
    assert not any(empty_side(city) for city in built.cities)
    assert all(empty_side(city) for city in opened.cities)


def test_hardly_any_buildings_are_not_a_city():
    cities = CityGenerator(kinds=("scattered",), open_land=1.0).draw(40, 0).cities
    assert min(city.buildings.mean() for city in cities) >= LEAST_BUILT


def test_buildings_in_a_no_fly_zone_stay_and_count_as_tall():
    low = {"low_share": (1.0, 1.0), "kinds": ("blocks",), "sizes": (24, 24)}
    for zones, tall in ((0, False), (4, True)):
        cities = CityGenerator(no_fly_zones=(zones, zones), **low).draw(10, 0)
        assert (cities.buildings & cities.no_fly).any() == tall


def test_low_buildings_and_no_fly_zones_come_up_in_the_shares_asked_for():
    generator = CityGenerator(low_share=(0.5, 0.5), no_fly_zones=(2, 2))
    cities = generator.draw(60, 1)
    low = (cities.buildings & ~cities.no_fly).sum() / cities.buildings.sum()
    assert 0.3 < low < 0.6
    pure = [(city.no_fly & ~city.buildings).any() for city in cities.cities]
    assert np.mean(pure) > 0.9
    every = set(range(len(KINDS)))
    assert every == set(np.unique([city.kinds for city in cities.cities]))


def test_equal_seeds_give_equal_cities_and_more_begin_with_the_same():
    first, again, more = DEFAULT.draw(5, 3), DEFAULT.draw(5, 3), DEFAULT.draw(8, 3)
    assert first.fingerprint == again.fingerprint != DEFAULT.draw(5, 4).fingerprint
    assert [city.fingerprint for city in more.cities[:5]] == [c.fingerprint for c in first.cities]
    assert [city.name for city in first.cities] == [city.name for city in more.cities[:5]]
    assert len({city.fingerprint for city in DEFAULT.draw(60, 0).cities}) == 60
    assert {city.name.rsplit("_", 2)[0] for city in more.cities} <= set(DEFAULT.kinds)


def test_every_kind_comes_up_about_as_often():
    kinds = [city.name.rsplit("_", 2)[0] for city in DEFAULT.draw(120, 5).cities]
    assert all(15 < kinds.count(kind) < 50 for kind in DEFAULT.kinds)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"sizes": (7, 16)}, r"cities: sizes is \(7, 16\), must be at least 8"),
        ({"sizes": (16, 101)}, "at most 100"),
        ({"sizes": (20, 16)}, "sizes from 20 to 16: must be from 8 to 100, the first not above"),
        ({"kinds": ("blocks", "castle")}, "'castle'; choose from blocks, scattered"),
        ({"kinds": ()}, "none; choose from"),
        ({"landing_zones": (0, 2)}, "landing_zones from 0 to 2: must be from 1"),
        ({"landing_zones": (3, 2)}, "first not above the second"),
        ({"low_share": (0.0, 1.5)}, "low_share from 0.0 to 1.5"),
        ({"no_fly_zones": (-1, 2)}, "no_fly_zones"),
        ({"open_land": 1.2}, "open_land is 1.2"),
    ],
)
def test_impossible_parameters_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        CityGenerator(**change)


def test_no_cities_are_refused():
    with pytest.raises(InputError, match="0 cities: must be at least 1"):
        DEFAULT.draw(0, 0)


def test_parameters_that_leave_no_room_are_an_error():
    with pytest.raises(InputError, match="fewer landing zones"):
        CityGenerator((8, 8), landing_zones=(8, 8)).draw(1, 0)


def test_a_name_stands_for_a_city_or_for_many(tmp_path):
    assert load_city("village").fingerprint == City.load("village").fingerprint
    random = load_city("random:3:7")
    assert random.fingerprint == DEFAULT.draw(3, 7).fingerprint
    for city in random.cities:
        city.save(tmp_path / f"{city.name}.png")
    assert load_city("random:3:7:24").fingerprint == CityGenerator((24, 24)).draw(3, 7).fingerprint
    mixed = load_city("random:40:7:8-12")
    assert set(mixed.sizes) == {8, 9, 10, 11, 12}
    assert len(load_city(tmp_path)) == 3
    assert load_city(tmp_path / f"{random[0].name}.png").fingerprint == random[0].fingerprint


@pytest.mark.parametrize(
    "name", ["random:", "random:3", "random:3:x", "random:-1:0", "random:1:2:8-", "random:1:2:8:9"]
)
def test_a_wrong_name_of_random_cities_says_how_to_write_it(name):
    with pytest.raises(CityError, match=f"{name}: write random:COUNT:SEED, such as random:300:1"):
        load_city(name)


def test_sizes_of_random_cities_have_bounds():
    with pytest.raises(InputError, match=r"cities: sizes is \(3, 3\), must be at least 8"):
        load_city("random:1:2:3")

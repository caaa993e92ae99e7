"""The menu of cities: the shipped ones, and on the labs' page the one that you paint there."""

from collections.abc import Callable

from uavdh_lite.city import City, shipped_cities
from uavdh_lite.environment import Environment
from uavdh_lite.errors import InputError, extra
from uavdh_lite.labs.draft import scenario_of
from uavdh_lite.missions import environment_of
from uavdh_lite.registry import names as known_names
from uavdh_lite.scenario import Scenario, find_scenario

with extra("notebooks"):
    import ipywidgets

MINE, LINKED = "my city", "the link's city"


class CityMenu(ipywidgets.Dropdown):
    """Cities to choose from. A city that cannot be flown is refused: the one before stays.

    Arguments:
        city: the name of a shipped city to start with, or the path of a PNG with your own.
        painted: returns the city to fly as *my city*, or raises `InputError`; without it, the menu
            has no such city.
        layout, style: of the widget.

    | attribute | meaning |
    | --- | --- |
    | `environment` | that of the chosen city |
    """

    def __init__(self, city: str, painted: Callable[[], City] | None = None, **options):
        names = shipped_cities()
        names += [city] * (city not in names) + [MINE] * (painted is not None)
        super().__init__(options=names, value=city, description="city", **options)
        self.environment = environment_of(city)
        self._painted, self._chosen = painted, city
        self._given: City | None = None

    @property
    def scenario(self) -> Scenario:
        """From which missions over the chosen city are drawn."""
        ours = self.value in (MINE, LINKED)
        return scenario_of(self.environment.city) if ours else _scenario_for(self.value)

    def on_choice(self, chosen: Callable[[bool], None], refused: Callable[[str], None]) -> None:
        """Call `chosen(again)` for another city, and `refused(reason)` for one that is refused.

        `again` is True if it is the city of before, painted further.
        """
        self._tell, self._refuse = chosen, refused
        self.observe(lambda _: self._choose(), "value")

    def take(self, city: City) -> None:
        """Choose this city, whether it is a shipped one or not."""
        if city.name in shipped_cities():
            shipped = environment_of(city.name).city
            if shipped.fingerprint == city.fingerprint:
                self.value = city.name
                return
        self._given, self._chosen = city, None  # so that it is taken even after another link's
        if LINKED not in self.options:
            self.options = [*self.options, LINKED]
        if self.value == LINKED:
            self._choose()
        self.value = LINKED

    def look_again(self) -> None:
        """Take up what has been painted since, if one's own city is chosen."""
        if self.value == MINE:
            self._choose(again=True)

    def _choose(self, again: bool = False) -> None:
        if self.value == self._chosen and not again:
            return
        try:
            environment = self._find()
        except InputError as error:
            self.value = self._chosen
            self._refuse(str(error))
            return
        if again and environment.city.fingerprint == self.environment.city.fingerprint:
            return
        self.environment, self._chosen = environment, self.value
        self._tell(again)

    def _find(self) -> Environment:
        if self.value == MINE:
            return Environment(self._painted())
        return Environment(self._given) if self.value == LINKED else environment_of(self.value)


def _scenario_for(city: str) -> Scenario:
    """The preset of a city's name, or else that for any city."""
    return find_scenario(city if city in known_names("scenario") else "any_city")

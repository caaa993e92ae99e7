"""Channel and shadow lab: one ray and the cells it crosses, SNR and rate, and the constants."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from uavdh_lite.channel import Channel, link, rate, rate_map
from uavdh_lite.city import City
from uavdh_lite.errors import extra
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.labs.menu import CityMenu
from uavdh_lite.labs.stage import FullScreen, together
from uavdh_lite.labs.widgets import ROW, WRAP, CellPicker, status, words
from uavdh_lite.plotting import BLUE, VERMILION, draw_city

with extra("notebooks"):
    import ipywidgets

FAINTEST = 1e-5  # data units a slot, the lower end of a logarithmic axis
RATE_ALPHA = 0.75  # of the colours over the city
CLEAR, BLOCKED = BLUE, VERMILION
WORDS = {
    "✕ and ◆ on the map": "the device on the ground, and the UAV above its cell. The brighter a "
    "cell, the more the UAV would hear from there; the scale is next to the map. Cells that the "
    "ray crosses are framed, buildings in its way in orange",
    "LoS, NLoS": "with and without line of sight. Any building between them blocks it, as if it "
    "were higher than the UAV: the model does not know how high buildings are",
    "slot": "the radio's unit of time; a step of the UAV has four",
    "SNR": "how much stronger the signal is than the noise, in decibels (dB): 10 dB is ten times "
    "as strong, −10 dB a tenth",
    "data units a slot": "log2(1 + SNR), what the link can carry",
    "α": "path loss exponent: how fast the signal fades with distance",
    "σ": "standard deviation of the fading, the random ups and downs of the signal; the bands "
    "around the curves are one σ wide on each side",
    "edge SNR": "the SNR of a device at the corner of the map, heard from its centre; it sets how "
    "strong the transmitters are",
}


class ChannelLab(ipywidgets.VBox):
    """Click to move the device or the UAV, and change the channel's constants.

    Arguments:
        city: the name of a shipped city to start with.
        painted: returns the city to use as *my city*; see `CityMenu`.
    """

    def __init__(self, city: str = "manhattan", painted: Callable[[], City] | None = None):
        self.city = CityMenu(city, painted)
        self.click = ipywidgets.ToggleButtons(
            options=["device", "UAV"],
            description="click moves",
            style={"button_width": "80px"},
            layout=ROW,
        )
        paper = Channel()
        self.constants = {
            "path_loss_exponent_los": _slider("α LoS", paper.path_loss_exponent_los, 1.5, 4, 0.01),
            "path_loss_exponent_nlos": _slider("α NLoS", paper.path_loss_exponent_nlos, 2, 6, 0.01),
            "fading_los_db": _slider("σ LoS, dB", paper.fading_db(1.0, True), 0, 6, 0.01),
            "fading_nlos_db": _slider("σ NLoS, dB", paper.fading_db(1.0, False), 0, 6, 0.01),
            "cell_edge_snr_db": _slider("edge SNR, dB", paper.cell_edge_snr_db, -30, 10, 1),
            "altitude_m": _slider("altitude, m", paper.altitude_m, 1, 100, 1),
        }
        self.picker = CellPicker(self.clicked)
        self.paper = ipywidgets.Button(
            description="the paper's constants", icon="undo", layout={"width": "180px"}
        )
        self.logarithmic = ipywidgets.Checkbox(description="logarithmic axis", indent=False)
        self.numbers, self.message = ipywidgets.HTML(), ipywidgets.HTML()
        figure = Figure(figsize=(8.6, 4.4), dpi=150)
        self.map = figure.add_axes((0.03, 0.06, 0.45, 0.88))
        self.bar = figure.add_axes((0.495, 0.06, 0.015, 0.88))
        self.curve = figure.add_axes((0.62, 0.12, 0.37, 0.8), facecolor="none")
        self.canvas = Canvas(figure, self._draw_again)
        sliders = ipywidgets.VBox([*self.constants.values(), self.paper, self.logarithmic])
        self.numbers.add_class("uavdh-sentence")
        super().__init__(
            [
                together(
                    [
                        ipywidgets.HBox(
                            [self.city, self.click, self.picker, FullScreen()], layout=WRAP
                        ),
                        ipywidgets.HBox([self.canvas.picture, sliders], layout=WRAP),
                        self.numbers,
                        self.message,
                    ]
                ),
                words(WORDS),
            ]
        )
        self._defaults = {name: slider.value for name, slider in self.constants.items()}
        self.paper.on_click(lambda _: self._reset())
        self.logarithmic.observe(lambda _: self._set_scale(), "value")
        self.city.on_choice(lambda _: self._set_city(), self._refuse)
        for slider in self.constants.values():
            slider.observe(lambda _: self._show(), "value")
        self.canvas.on_click(self._clicked)
        ramp = self.bar.imshow(np.linspace(1, 0, 100)[:, None], "viridis", alpha=RATE_ALPHA)
        ramp.set_extent((0, 1, 0, 1))
        self.bar.set(aspect="auto", xticks=[], yticks=[])
        self._set_city()

    @property
    def channel(self) -> Channel:
        """The channel that the sliders describe."""
        values = {name: float(slider.value) for name, slider in self.constants.items()}
        for kind in ("los", "nlos"):
            values[f"fading_variance_{kind}_db2"] = values.pop(f"fading_{kind}_db") ** 2
        return replace(Channel(), **values)

    def _reset(self) -> None:
        """Give the channel the paper's constants again."""
        for name, slider in self.constants.items():
            slider.value = self._defaults[name]

    def _set_scale(self) -> None:
        """Show rates on a logarithmic axis, where shadows are not all next to 0; or back."""
        self.curve.set_yscale("log" if self.logarithmic.value else "linear")
        self._draw_again()

    def _set_city(self) -> None:
        """The chosen city, with a device in the middle and the UAV in the landing zone."""
        self.message.value = ""
        self.environment = self.city.environment
        city = self.environment.city
        middle = len(city.device_cells) // 2
        self.picker.row.max = self.picker.column.max = city.size - 1
        self.device = divmod(int(city.device_cells[middle]), city.size)
        self.uav = divmod(int(city.landing_cells[0]), city.size)
        self.map.clear()
        draw_city(self.map, city).set(xlabel="", ylabel="")
        self.rates = self.map.imshow(
            np.zeros((city.size, city.size)),
            "viridis",
            alpha=RATE_ALPHA,
            zorder=1.5,
            animated=True,
        )
        self.map.set_title("data units a slot; ✕ device, ◆ UAV", fontsize="medium")
        self.curve.clear()
        self.curve.set(xlabel="distance on the ground, m", ylabel="data units a slot")
        self.curve.set(xlim=(0, 10 * city.size * 1.4))
        self.top = 0
        self._show()

    def _draw_again(self) -> None:
        self.top = 0  # draw the axes again
        self._show()

    def _refuse(self, reason: str) -> None:
        self.message.value = status(reason)

    def _clicked(self, ax, x: float, y: float) -> None:
        if ax is self.map:
            self.clicked((round(y), round(x)))

    def clicked(self, cell: tuple[int, int]) -> None:
        """Move what `click` says to this cell, (row, column), unless it is outside the city."""
        size = self.environment.city.size
        if not (0 <= cell[0] < size and 0 <= cell[1] < size):
            return
        if self.click.value == "device":
            self.device = cell
        else:
            self.uav = cell
        self._show()

    def _show(self) -> None:
        """Draw what changes (rates, ray, crossed cells, curves) and write the numbers."""
        channel, city = self.channel, self.environment.city
        found = link(city, channel, self.device, self.uav)
        rates = rate_map(city, channel, self.environment.line_of_sight, self.device)
        most = rates[~city.no_fly].max()
        self.rates.set_data(np.where(city.no_fly, np.nan, rates))
        scale = max(most, 1e-6)
        self.rates.set_clim(0, scale)
        artists = [
            self.rates,
            *self._draw_ray(found),
            *self._draw_curves(channel, found),
            *self._draw_scale(scale),
        ]
        top = max(np.max(line.get_ydata()) for line in self.curve.lines)
        if not top <= self.top <= 2 * top + 1:  # the curves leave the axes, or are small in them
            self.top = np.ceil(1.2 * top)
            self.curve.set_ylim(FAINTEST if self.logarithmic.value else 0, self.top)
            for artist in artists:
                artist.set_animated(True)
            self.canvas.draw_all()
        said = f"{self._sentence(found)}; in the brightest cell {most:.3g} units. {self._warning()}"
        places = f"device in cell {self.device}, UAV over {self.uav}"
        self.canvas.draw(
            [(artist.axes, artist) for artist in artists],
            f"Rates over {city.name}, and by distance; {places}: {said}",
        )
        for artist in artists[1:]:
            artist.remove()
        self.numbers.value = said

    def _draw_ray(self, found) -> list:
        colour = CLEAR if found.line_of_sight else BLOCKED
        artists = []
        for row, col in found.crossed:
            hit = (found.blocked_by == (row, col)).all(axis=1).any()
            cell = Rectangle((col - 0.5, row - 0.5), 1, 1, fill=False, zorder=3)
            cell.set(edgecolor=BLOCKED if hit else CLEAR, linewidth=2 if hit else 1)
            artists.append(self.map.add_patch(cell))
        (from_row, from_col), (to_row, to_col) = self.device, self.uav
        artists += self.map.plot([from_col, to_col], [from_row, to_row], color=colour, zorder=4)
        artists += self.map.plot(from_col, from_row, "X", color="white", mec="black", ms=11)
        artists += self.map.plot(to_col, to_row, "D", color="white", mec="black", ms=9)
        return artists

    def _draw_scale(self, most: float) -> list:
        """The numbers next to the colours, up to that of the brightest."""
        return [
            self.bar.text(1.4, share, f" {share * most:.3g}", va=where, fontsize="small")
            for share, where in ((0, "bottom"), (0.5, "center"), (1, "top"))
        ]

    def _draw_curves(self, channel: Channel, found) -> list:
        ground_m = np.linspace(0, self.curve.get_xlim()[1], 150)
        squared, size = np.float32(ground_m**2 + channel.altitude_m**2), self.environment.city.size
        artists = []
        for sight, colour, label in ((True, CLEAR, "LoS"), (False, BLOCKED, "NLoS")):
            snr_db = channel.mean_snr_db(squared, sight, size)
            spread = channel.fading_db(1.0, sight)
            low, high = rate(snr_db - spread), rate(snr_db + spread)
            artists += self.curve.plot(ground_m, rate(snr_db), color=colour, label=label)
            artists.append(
                self.curve.fill_between(ground_m, low, high, color=colour, alpha=0.25, lw=0)
            )
        artists.append(self.curve.legend(loc="upper right"))
        artists.append(self.curve.axhline(found.rate, color="black", ls="--", lw=0.8))
        artists += self.curve.plot(found.ground_m, found.rate, "o", color="black", ms=8)
        return artists

    def _warning(self) -> str:
        """What the formulas allow, but no mission does."""
        city = self.environment.city
        wrong = [
            text
            for text, cell, forbidden in (
                ("devices do not stand on buildings", self.device, city.buildings),
                ("the UAV may not fly here", self.uav, city.no_fly),
            )
            if forbidden[cell]
        ]
        return f"(In a mission: {', '.join(wrong)}.)" if wrong else ""

    def _sentence(self, found) -> str:
        count = len(found.blocked_by)
        cells = "a building in 1 cell" if count == 1 else f"buildings in {count} cells"
        sight = "line of sight" if found.line_of_sight else f"no line of sight: {cells}"
        said = (
            f"{found.ground_m:.1f} m on the ground, {found.distance_m:.1f} m through the air, "
            f"{sight}; SNR {found.snr_db:.1f} dB (± {found.fading_db:.1f} dB fading); "
            f"{found.rate:.3g} data units a slot"
        )
        if found.line_of_sight:
            return said
        squared = np.float32(found.distance_m**2)
        clear_db = self.channel.mean_snr_db(squared, True, self.environment.city.size)
        cost_db = clear_db - found.snr_db
        return (
            f"{said}. Without buildings it would be {clear_db:.1f} dB: they cost {cost_db:.1f} dB"
        )


def _slider(name: str, value: float, low: float, high: float, step: float):
    return ipywidgets.FloatSlider(
        value=value,
        min=low,
        max=high,
        step=step,
        description=name,
        style={"description_width": "100px"},
    )

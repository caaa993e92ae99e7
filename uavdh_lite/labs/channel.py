"""Channel and shadow lab: one ray and the cells it crosses, SNR and rate, and the constants."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import PatchCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from uavdh_lite.channel import Channel, rate, rate_map
from uavdh_lite.city import City
from uavdh_lite.errors import extra
from uavdh_lite.labs.canvas import Canvas
from uavdh_lite.labs.link import link
from uavdh_lite.labs.menu import CityMenu
from uavdh_lite.labs.stage import FullScreen, together
from uavdh_lite.labs.widgets import ROW, WRAP, CellPicker, cell_at, status, words
from uavdh_lite.plotting import BLUE, LANDING, LOW, NO_FLY, TALL, VERMILION, draw_city

with extra("notebooks"):
    import ipywidgets

FAINTEST = 1e-5  # data units a slot, the lower end of logarithmic axes and colours
HEARD = 0.1  # data units a slot; what a device must bring to be called heard
RATE_ALPHA = 0.75  # of the colours over the city
# Hatches on top of the colours, in colours that are seen on dark and on bright ones
ON_TOP = {
    "no-fly zone": {"edgecolor": "#FF6B6B", "hatch": NO_FLY["hatch"]},
    "landing zone": {"edgecolor": "#9DC3E6", "hatch": LANDING["hatch"]},
    "low building": {"edgecolor": LOW["facecolor"], "hatch": LOW["hatch"]},
}
CLEAR, BLOCKED = BLUE, VERMILION
WORDS = {
    "✕ and ◆ on the map": "the device on the ground, and the UAV above its cell: drag them. The "
    "brighter a cell, the more the UAV would hear from there; the scale is next to the map. Cells "
    "that the ray crosses are framed, buildings in its way in orange. The radio passes over no-fly "
    "zones",
    "logarithmic": "each step of the axis and of the colours is ten times as much as the one "
    "before, so that what is heard behind buildings can be seen, too",
    "heard": f"at least {HEARD:g} data units a slot, on average: a device with 10 units is then "
    "empty after 100 slots, which are 25 steps",
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
    """Drag the device or the UAV, and change the channel's constants.

    A click, or a drag that begins at neither of them, moves the one that `click` says.

    Arguments:
        city: the name of a shipped city to start with.
        painted: returns the city to use as *my city*; see `CityMenu`.
    """

    def __init__(self, city: str = "manhattan", painted: Callable[[], City] | None = None):
        self.city = CityMenu(city, painted)
        self.click = ipywidgets.ToggleButtons(
            options=["device", "UAV"],
            description="click moves",
            style={"button_width": "80px", "description_width": "90px"},
            layout=ROW | {"margin": "2px 2px 2px 16px"},
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
        self.logarithmic = ipywidgets.Checkbox(description="logarithmic", indent=False)
        self.numbers, self.message = ipywidgets.HTML(), ipywidgets.HTML()
        self.seen = ipywidgets.HTML(layout={"min_height": "60px", "width": "300px"})
        figure = Figure(figsize=(8.6, 4.7), dpi=150)
        self.map = figure.add_axes((0.03, 0.12, 0.45, 0.82))
        self.bar = figure.add_axes((0.495, 0.12, 0.015, 0.82))
        self.curve = figure.add_axes((0.645, 0.18, 0.335, 0.76), facecolor="none")
        self._explain_cells(figure)
        self.canvas = Canvas(figure, self._draw_again)
        sliders = ipywidgets.VBox(
            [*self.constants.values(), self.paper, self.logarithmic, self.seen]
        )
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
        self.click.observe(lambda _: self._point_picker(), "value")
        self.canvas.on_drag(self._dragged, self.look_at, lambda: None)
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
        self.curve.yaxis.set_major_formatter(lambda value, _: _trim(f"{value:.5f}"))
        self._draw_again()

    def _set_city(self) -> None:
        """The chosen city, with a device in the middle and the UAV in the landing zone."""
        self.message.value = ""
        self.environment = self.city.environment
        city = self.environment.city
        middle = len(city.device_cells) // 2
        self.picker.row.max = self.picker.column.max = city.size - 1
        self.device = divmod(int(city.device_cells[middle]), city.size)
        self.uav = divmod(int(np.flatnonzero(city.landing)[0]), city.size)
        self.map.clear()
        draw_city(self.map, city).set(xlabel="", ylabel="")
        self.rates = self.map.imshow(
            np.zeros((city.size, city.size)),
            "viridis",
            alpha=RATE_ALPHA,
            zorder=1.5,
            animated=True,
        )
        self.hatches = self._hatch(city)
        self.map.set_title("data units a slot; ✕ device, ◆ UAV", fontsize="medium")
        self.curve.clear()
        self.curve.set(xlabel="distance on the ground, m", xlim=(0, 10 * city.size * 1.4))
        self.curve.set_title("data units a slot, by distance", fontsize="medium")
        self._point_picker()
        self._set_scale()

    def _draw_again(self) -> None:
        self.top = 0  # draw the axes again
        self._show()

    def _refuse(self, reason: str) -> None:
        self.message.value = status(reason)

    def _dragged(self, ax, points: list[tuple[float, float]], began: bool) -> None:
        """Move what was under the mouse when its button went down; else what `click` says."""
        cell = cell_at(points[-1])
        if began:
            here = [what for what, at in self._places().items() if at == cell]
            self._held = here[0] if len(here) == 1 else self.click.value
        if ax is self.map and cell != self._places()[self._held]:
            self._move(self._held, cell)

    def _places(self) -> dict[str, tuple[int, int]]:
        return {"device": self.device, "UAV": self.uav}

    def _point_picker(self) -> None:
        """Show in the boxes where that stands which a click moves."""
        self.picker.row.value, self.picker.column.value = self._places()[self.click.value]

    def clicked(self, cell: tuple[int, int]) -> None:
        """Move what `click` says to this cell, (row, column), unless it is outside the city."""
        self._move(self.click.value, cell)

    def _move(self, what: str, cell: tuple[int, int]) -> None:
        size = self.environment.city.size
        if not (0 <= cell[0] < size and 0 <= cell[1] < size):
            return
        if what == "device":
            self.device = cell
        else:
            self.uav = cell
        self.picker.row.value, self.picker.column.value = cell
        self._show()

    def look_at(self, ax, x: float, y: float) -> None:
        """Say what the UAV would hear in the cell under the mouse."""
        row, col = cell = cell_at((x, y))
        size = self.environment.city.size
        if ax is not self.map or not (0 <= row < size and 0 <= col < size):
            self.seen.value = ""
            return
        found = link(self.environment.city, self.channel, self.device, cell)
        sight = "line of sight" if found.line_of_sight else "no line of sight"
        self.seen.value = (
            f"Under the mouse, row {row}, column {col}: {plain(found.rate)} data units a slot, "
            f"{sight}."
        )

    def reach(self, line_of_sight: bool) -> float:
        """How far away on the ground a device is heard, m; NaN if not even from above."""
        channel, size = self.channel, self.environment.city.size
        alpha = channel.path_loss_exponent_los if line_of_sight else channel.path_loss_exponent_nlos
        needed_db = 10 * np.log10(2**HEARD - 1)
        far = 10 ** ((channel.transmit_snr_db(size) - needed_db) / (10 * alpha))
        return np.sqrt(far**2 - channel.altitude_m**2) if far >= channel.altitude_m else np.nan

    def _show(self) -> None:
        """Draw what changes (rates, ray, crossed cells, curves) and write the numbers."""
        channel, city = self.channel, self.environment.city
        found = link(city, channel, self.device, self.uav)
        rates = rate_map(city, channel, self.environment.sight[0], self.device)
        tall = city.buildings & city.no_fly
        scale = max(rates[~tall].max(), 10 * FAINTEST)
        self.rates.set_data(np.where(tall, np.nan, np.maximum(rates, FAINTEST)))
        self.rates.set_norm(
            LogNorm(FAINTEST, scale) if self.logarithmic.value else Normalize(0, scale)
        )
        artists = [
            self.rates,
            *self.hatches,
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
        said = [f"{self._sentence(found)} {self._warning()}".strip(), self._range()]
        places = f"device in cell {self.device}, UAV over {self.uav}"
        self.canvas.draw(
            [(artist.axes, artist) for artist in artists],
            f"Rates over {city.name}, and by distance; {places}: {' '.join(said)}",
        )
        for artist in artists[1 + len(self.hatches) :]:
            artist.remove()
        self.seen.value = ""  # it was of another link
        self.numbers.value = "".join(f"<div>{each}</div>" for each in said)

    def _hatch(self, city: City) -> list[PatchCollection]:
        """What kind a cell is, on top of its colour."""
        kinds = {
            "no-fly zone": city.no_fly & ~city.buildings,
            "landing zone": city.landing,
            "low building": city.buildings & ~city.no_fly,
        }
        hatches = []
        for name, mask in kinds.items():
            cells = [Rectangle((col - 0.5, row - 0.5), 1, 1) for row, col in np.argwhere(mask)]
            style = {"facecolor": "none", "linewidth": 0, "zorder": 2} | ON_TOP[name]
            hatches.append(self.map.add_collection(PatchCollection(cells, animated=True, **style)))
        return hatches

    def _explain_cells(self, figure: Figure) -> None:
        """A legend of the kinds of cells, as they look where hardly anything is heard."""
        ground = colormaps["viridis"](0.0)
        handles = [Patch(facecolor=TALL["facecolor"], label="tall building")]
        handles += [
            Patch(facecolor=ground, linewidth=0, label=name, **style)
            for name, style in ON_TOP.items()
        ]
        figure.legend(
            handles=handles,
            loc="lower left",
            bbox_to_anchor=(0.015, -0.01),
            ncols=4,
            fontsize="small",
            frameon=False,
            columnspacing=1.2,
            handletextpad=0.4,
        )

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
        if self.logarithmic.value:
            decades = 10.0 ** np.arange(np.log10(FAINTEST), np.log10(most / 1.8))
            values = [*decades.tolist(), most]
        else:
            values = [0.0, most / 2, most]
        shares = self.rates.norm(values)
        return [
            self.bar.text(1.4, share, f" {plain(value)}", va="center", fontsize="small")
            for share, value in zip(shares, values, strict=True)
        ]

    def _mean_snr_db(self, squared_distance_m2, sight: bool):
        """The SNR without fading at these squared distances, dB."""
        transmit_db = np.float32(self.channel.transmit_snr_db(self.environment.city.own_size))
        return transmit_db - self.channel.path_loss_db(squared_distance_m2, sight)

    def _draw_curves(self, channel: Channel, found) -> list:
        ground_m = np.linspace(0, self.curve.get_xlim()[1], 150)
        squared = np.float32(ground_m**2 + channel.altitude_m**2)
        artists = []
        for sight, colour, label in ((True, CLEAR, "LoS"), (False, BLOCKED, "NLoS")):
            snr_db = self._mean_snr_db(squared, sight)
            spread = channel.fading_db(1.0, sight)
            low, high = rate(snr_db - spread), rate(snr_db + spread)
            artists += self.curve.plot(ground_m, rate(snr_db), color=colour, label=label)
            artists.append(
                self.curve.fill_between(ground_m, low, high, color=colour, alpha=0.25, lw=0)
            )
        artists.append(self.curve.legend(loc="upper right"))
        shown = max(found.rate, FAINTEST)
        artists.append(self.curve.axhline(shown, color="black", ls="--", lw=0.8))
        artists += self.curve.plot(found.ground_m, shown, "o", color="black", ms=8, clip_on=False)
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
        """What this link brings, and what buildings take from it."""
        count = len(found.blocked_by)
        cells = "a building in 1 cell" if count == 1 else f"buildings in {count} cells"
        sight = "line of sight" if found.line_of_sight else f"no line of sight: {cells}"
        said = (
            f"This link: {found.ground_m:.1f} m on the ground, {found.distance_m:.1f} m through "
            f"the air, {sight}; SNR {_decibels(found.snr_db)} (± {found.fading_db:.1f} dB fading); "
            f"{plain(found.rate)} data units a slot."
        )
        if found.line_of_sight:
            return said
        squared = np.float32(found.distance_m**2)
        clear_db = self._mean_snr_db(squared, True)
        return (
            f"{said} Without buildings it would be {_decibels(clear_db)}, "
            f"{plain(rate(clear_db))} units: they cost {_decibels(clear_db - found.snr_db)}."
        )

    def _range(self) -> str:
        """How far away a device is heard."""
        with_sight, behind = (
            "nowhere" if np.isnan(far) else f"{far:.0f} m"
            for far in (self.reach(True), self.reach(False))
        )
        return (
            f"Any device here is heard down to {HEARD:g} units a slot: {with_sight} with line of "
            f"sight, {behind} behind a building."
        )


def _decibels(value: float) -> str:
    return f"{value:.1f} dB".replace("-", "−")


def plain(value: float) -> str:
    """A rate with two decimals, or with its first digit that is not 0."""
    digits = 2 if value >= 0.01 or value <= 0 else int(np.ceil(-np.log10(value) - 1e-9))
    return _trim(f"{value:.{digits}f}") if digits < 8 else "0"


def _trim(number: str) -> str:
    return number.rstrip("0").rstrip(".")


def _slider(name: str, value: float, low: float, high: float, step: float):
    return ipywidgets.FloatSlider(
        value=value,
        min=low,
        max=high,
        step=step,
        description=name,
        style={"description_width": "100px"},
    )

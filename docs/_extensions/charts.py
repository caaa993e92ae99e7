"""The charts of the results, one style for all, drawn from the recorded files in `data/runs`.

`python benchmarks/figures.py` writes them as SVG into `data/figures/results`. One file serves light
and dark pages: it has a rule that turns its paper and ink round where dark ones are asked for.
"""

import hashlib
import io
import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from tables import BOTH, KNOWLEDGE, RUNS, ends_of, flown_by, flown_over_places, kind_of, runs_of

from uavdh_lite.beyond.measured import shipped_places
from uavdh_lite.city import City
from uavdh_lite.evaluation import bootstrap_interval, paired_interval
from uavdh_lite.experiments.comparison import breakdown
from uavdh_lite.paper import RESULTS
from uavdh_lite.plotting import BLUE, GREEN, PINK, VERMILION, draw_city
from uavdh_lite.storage import read_table, write_atomically

OUT = RUNS.parent / "figures" / "results"
WIDTH = 8.6  # inches: letters of 11 points are about as large as those of the site's text
INK, PAPER, FAINT = "#1f2328", "#ffffff", "#d1d9e0"
GRID = "#dddddd"  # of maps
DARK = {  # what each colour becomes on a dark page
    INK: "#e6edf3",
    PAPER: "#131416",
    FAINT: "#3d444d",
    GRID: "#3d444d",
    BLUE.lower(): "#56b4e9",
    GREEN.lower(): "#2fc89c",
    VERMILION.lower(): "#f0883e",
}
STYLE = {
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.facecolor": PAPER,
    "axes.labelcolor": INK,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": "medium",
    "axes.titleweight": "bold",
    "figure.facecolor": PAPER,
    "font.sans-serif": ["DejaVu Sans", "Verdana"],  # which are as wide as each other
    "font.size": 10,
    "grid.color": FAINT,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "uavdh_lite",
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "ytick.left": False,
}
Kind = tuple[str, str, str]  # what the legend says, colour, marker
LEARNED: dict[str, Kind] = {
    "rule": ("rule or planner", INK, "s"),
    "reward": ("learned from reward alone", BLUE, "o"),
    "copied": ("copied a planner", VERMILION, "D"),
}
PILOTS = {  # of the ladder, each with how it came by what it does
    "random": ("random", "rule"),
    "plain": ("plain agent", "reward"),
    "ddqn": ("DDQN agent", "reward"),
    "ddqn_failsafe": ("DDQN with a failsafe", "reward"),
    "greedy": ("greedy rule", "rule"),
    "orienteering": ("best order of devices", "rule"),
    "ddqn_told": ("DDQN, failsafe, told", "reward"),
    "any_city": ("agent for any city", "copied"),
    "copy": ("copy of the teacher", "copied"),
    "imitation": ("imitation agent", "copied"),
    "teacher": ("teacher, a planner", "rule"),
}
FEW = ("random", "plain", "ddqn", "greedy", "ddqn_told", "imitation", "teacher")
TABLE_II = ("plain", "ddqn", "greedy")
MAPS = {"manhattan": "Manhattan", "open_field": "Open field"}
CENTRED: Kind = ("map centred on the UAV", BLUE, "o")
IN_PLACE: Kind = ("map in place", VERMILION, "D")
CENTRING = {"centred": CENTRED, "non_centred": IN_PLACE}
PAPERS: Kind = ("the paper's agents, on their own map", PINK, "*")
ENDS = ("", "_low", "_high")


def number(value: float, digits: int = 1) -> str:
    return f"{value:.{digits}f}".replace("-", "−")


def _figure(height: float, width: float = WIDTH) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def _rows(ax: Axes, names: Sequence[str]) -> None:
    """A line for each name, the first at the top."""
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.grid(axis="y", lw=0.6)


def _dots(ax: Axes, values: Iterable[float], row: float, kind: Kind, size: float = 7) -> None:
    for value in values:
        ax.plot(value, row, kind[2], color=kind[1], mec=PAPER, mew=0.8, ms=size)


def _interval(ax: Axes, row: float, found: Sequence[float], kind: Kind, shown: str = "") -> None:
    """A mean with its interval, and a number beside it; what is off the scale is an arrow."""
    mean, low, high = found
    left = ax.get_xlim()[0]
    if mean < left:
        ax.annotate(f"◀ {shown}", (left, row), (3, 0), textcoords="offset points", va="center")
        return
    ax.plot((low, high), (row, row), color=kind[1], lw=2, solid_capstyle="butt")
    _dots(ax, [mean], row, kind)
    at = (max(mean, high), row)
    ax.annotate(shown, at, (8, 0), textcoords="offset points", va="center", size="small")


def _marks(ax: Axes, titles: Sequence[str], marks: Sequence[Sequence[bool]]) -> None:
    """A column for each title, and a large dot in those that a row has."""
    for row, has in enumerate(marks):
        for column, mark in enumerate(has):
            ax.plot(column, row, "o", color=INK if mark else FAINT, ms=7 if mark else 3)
    ax.set_xticks(range(len(titles)), titles, rotation=50, ha="left", rotation_mode="anchor")
    ax.set_xlim(-0.6, len(titles) - 0.4)
    ax.tick_params(bottom=False, labelbottom=False, labeltop=True, pad=0)
    ax.spines[:].set_visible(False)


def _legend(figure: Figure, kinds: Iterable[Kind]) -> None:
    signs = [Line2D([], [], ls="", marker=m, color=c, label=label) for label, c, m in kinds]
    figure.legend(handles=signs, loc="outside lower center", ncols=len(signs))


def _ladder() -> tuple[dict[str, np.ndarray], dict[tuple[str, str], int]]:
    table = read_table(RUNS / "ladder.csv.gz")
    names = zip(table["scenario"].tolist(), table["row"].tolist(), strict=True)
    return table, {name: row for row, name in enumerate(names)}


def ladder(pilots: Sequence[str] = tuple(PILOTS), width: float = WIDTH) -> Figure:
    """The return ahead of greedy, with its interval, and what each pilot knows."""
    table, at = _ladder()
    figure = _figure(1.7 + 0.29 * len(pilots), width)
    knows, *axes = figure.subplots(1, 3, sharey=True, width_ratios=(1.2, 2, 2))
    known = [[table[f"knows_{what}"][at["manhattan", p]] for what in KNOWLEDGE] for p in pilots]
    _marks(knows, list(KNOWLEDGE.values()), known)
    _rows(knows, [PILOTS[pilot][0] for pilot in pilots])
    for ax, (name, title) in zip(axes, MAPS.items(), strict=True):
        ax.axvline(0, color=INK, lw=0.8)
        ax.grid(axis="y", lw=0.6)
        ax.set(title=title, xlabel="return ahead of greedy", xlim=(-6.6, 4.4))
        ax.set_xticks(range(-6, 5, 2))
        for row, pilot in enumerate(pilots):
            if (name, pilot) in at:
                found = [table[f"return_ahead{end}"][at[name, pilot]] for end in ENDS]
                shown = "" if pilot == "greedy" else number(found[0])
                _interval(ax, row, found, LEARNED[PILOTS[pilot][1]], shown)
    _legend(figure, LEARNED.values())
    return figure


def claims() -> Figure:
    """Table II beside our pilots, and the ends of the runs of the ablation."""
    table, at = _ladder()
    figure = _figure(2.9)
    *axes, ablation = figure.subplots(1, 3)
    for ax, (name, title) in zip(axes, MAPS.items(), strict=True):
        names = ["the paper", *(PILOTS[pilot][0] for pilot in TABLE_II)]
        _rows(ax, names if ax is axes[0] else [""] * len(names))
        ax.set(title=f"Table II, {title}", xlabel="collected and landed, %", xlim=(79, 102))
        _dots(ax, [100 * RESULTS[name][BOTH]], 0, PAPERS, 12)
        for row, pilot in enumerate(TABLE_II, start=1):
            found = [100 * table[f"{BOTH}{end}"][at[name, pilot]] for end in ENDS]
            _interval(ax, row, found, LEARNED[PILOTS[pilot][1]])
    recipes = ("plain", "lite")
    _rows(ablation, recipes)
    ablation.set(title="Centring, Manhattan", xlabel="collected and landed, %", xlim=(0, 102))
    for row, recipe in enumerate(recipes):
        for arm, end in ends_of(f"centring_{recipe}-manhattan").items():
            _dots(ablation, 100 * end[BOTH], row + 0.3 * (arm != "centred"), CENTRING[arm])
    ablation.set_ylim(1.7, -0.5)
    _legend(figure, (PAPERS, CENTRED, IN_PLACE))
    return figure


def agents() -> Figure:
    """The shipped agents and the better genie, ahead of greedy."""
    figure, names = _figure(4.6), []
    axes = figure.subplots(1, 2, sharey=True)
    axes[0].set(title="collected and landed, percentage points", xlim=(-6, 16))
    axes[1].set(title="return, data units", xlim=(-2, 16))
    for scenario in ("manhattan", "open_field", "harbour", "metropolis", "any_city"):
        flown = flown_by(scenario)
        for name, mine in flown.items():
            if name in ("random", "greedy", "genie_data"):
                continue
            kind = "rule" if name == "genie" else "reward" if "ddqn" in name else "copied"
            for ax, metric, factor in zip(axes, (BOTH, "return"), (100, 1), strict=True):
                ahead = factor * (mine[metric] - flown["greedy"][metric])
                found = paired_interval(ahead, mine.get("city"))
                _interval(ax, len(names), found, LEARNED[kind], number(found.mean))
            names.append(f"{scenario}: genie" if name == "genie" else name)
    for ax in axes:
        ax.axvline(0, color=INK, lw=0.8)
        ax.set_xlabel("ahead of greedy")
        _rows(ax, names)
    _legend(figure, LEARNED.values())
    return figure


def steps() -> Figure:
    """Validations on the way: the paper's algorithm and the strengthened DDQN, run by run."""
    table, at = _ladder()
    figure = _figure(3)
    studies = {
        "plain agent": ("centring_plain-manhattan", VERMILION),
        "DDQN agent": ("ddqn-manhattan", BLUE),
    }
    for ax, metric in zip(figure.subplots(1, 2), (BOTH, "return"), strict=True):
        for name, (study, colour) in studies.items():
            for run in next(iter(runs_of(study).values())):
                label = name if run["seed"][0] == 0 else None
                ax.plot(run["steps"] / 1e6, run[metric], color=colour, lw=1.2, label=label)
        greedy = table[metric][at["manhattan", "greedy"]]
        ax.axhline(greedy, color=INK, ls="--", lw=1.2, label="greedy rule")
        ax.set(xlabel="million steps", title=f"{metric.replace('_', ' ')}, Manhattan")
    figure.axes[0].set_ylim(0.5, 1)
    figure.axes[1].set_ylim(0, 40)
    figure.axes[0].legend(loc="lower right")
    return figure


def centring() -> Figure:
    """The ablation: validations of each run with the map centred and in place."""
    figure = _figure(3)
    for ax, recipe in zip(figure.subplots(1, 2, sharey=True), ("plain", "lite"), strict=True):
        for arm, runs in runs_of(f"centring_{recipe}-manhattan").items():
            for run in runs:
                ax.plot(run["steps"] / 1e6, run[BOTH], color=CENTRING[arm][1], lw=1.2)
        ax.set(title=f"recipe {recipe}, Manhattan", xlabel="million steps")
    figure.axes[0].set(ylabel="collected and landed", ylim=(0, 1))
    signs = [Line2D([], [], color=kind[1], label=kind[0]) for kind in CENTRING.values()]
    figure.axes[1].legend(handles=signs, loc="lower right")
    return figure


def parts() -> Figure:
    """The end of each run without one part, and of `lite`, in both arms, a dot a run."""
    ends = ends_of("pilots-manhattan") | ends_of("short-manhattan")
    names = [name.removeprefix("centred_") for name in ends if name.startswith("centred_")]
    names.sort(key=lambda name: -ends[f"centred_{name}"][BOTH].mean())
    figure = _figure(1 + 0.27 * len(names))
    for ax, metric in zip(figure.subplots(1, 2, sharey=True), (BOTH, "return"), strict=True):
        _rows(ax, [name.replace("_", " ") for name in names])
        ax.set_title(f"{metric.replace('_', ' ')} in validation")
        for row, name in enumerate(names):
            for arm, kind, aside in (("centred", CENTRED, -0.13), ("in_place", IN_PLACE, 0.13)):
                if f"{arm}_{name}" in ends:
                    _dots(ax, ends[f"{arm}_{name}"][metric], row + aside, kind, 6)
    figure.axes[0].set_xlim(-0.03, 1.03)
    _legend(figure, (CENTRED, IN_PLACE))
    return figure


def four_ways() -> Figure:
    """The end of each run: with and without guarantee, telling, copying and learning."""
    ways, ends = ("guarantee", "tell", "copy", "learn"), ends_of("four_ways-manhattan")
    names = sorted(ends, key=lambda name: ends[name]["return"].mean())
    figure = _figure(1.3 + 0.29 * len(names))
    marks, *axes = figure.subplots(1, 3, sharey=True, width_ratios=(1, 2, 2))
    _marks(marks, ways, [[way in name.split("_") for way in ways] for name in names])
    _rows(marks, [""] * len(names))
    for ax, metric in zip(axes, ("return", BOTH), strict=True):
        ax.grid(axis="y", lw=0.6)
        ax.set_xlabel(f"{metric.replace('_', ' ')}, a dot for each run")
        for row, name in enumerate(names):
            kind = LEARNED["copied" if "copy" in name else "reward"]
            _dots(ax, ends[name][metric], row, kind)
    _legend(figure, (LEARNED["reward"], LEARNED["copied"]))
    return figure


def any_city() -> Figure:
    """The lead over greedy by flying time and kind of city; and how many cities it takes."""
    flown = flown_by("any_city")
    mine, city = flown["any_city"], flown["any_city"]["city"]
    ahead = 100 * (mine[BOTH] - flown["greedy"][BOTH])
    groups = breakdown(ahead, mine["flying_time"], city), breakdown(ahead, kind_of(city), city)
    names = [f"flying time {label}" for label, *_ in groups[0]] + [each[0] for each in groups[1]]
    figure = _figure(3.3)
    left, right = figure.subplots(1, 2)
    left.axvline(0, color=INK, lw=0.8)
    left.set(title="Unseen cities: ahead of greedy", xlabel="collected and landed, points")
    left.set_xlim(-6, 9)
    for row, (_, _, found) in enumerate([*groups[0], *groups[1]]):
        _interval(left, row, found, LEARNED["copied"], number(found.mean))
    _rows(left, names)
    table = read_table(RUNS / "unseen_cities.csv.gz")
    counts = (1, 10, 100, 2000)
    for count in counts:
        of = (table["policy"] == "centred") & (table["learned_in"] == f"random:{count}:0")
        for unseen, colour, marker in ((False, GREEN, "^"), (True, BLUE, "o")):
            over = of & ((table["flown_over"] == "random:300:9") == unseen)
            label = f"over {'unseen cities' if unseen else 'its own cities'}" * (count == 1)
            right.plot(over[over] * count, table[BOTH][over], marker, color=colour, label=label)
    greedy = (table["policy"] == "greedy") & (table["flown_over"] == "random:300:9")
    label = "greedy, over the unseen ones"
    right.axhline(table[BOTH][greedy].mean(), color=INK, ls="--", lw=1.2, label=label)
    right.set(xscale="log", xlabel="cities to learn in, recipe told", ylabel="collected and landed")
    right.set_xticks(counts, map(str, counts))
    right.minorticks_off()
    right.set_title("How many cities it takes")
    right.legend(loc="center right", fontsize="small")
    return figure


def real_city() -> Figure:
    """Four real places, and by how much the agent for any city is ahead of greedy there."""
    figure = _figure(4.4)
    places = shipped_places()
    axes = figure.subplots(2, len(places), height_ratios=(2, 1))
    told = {
        ("model", "model"): ("the paper's radio, told it", BLUE, "o"),
        ("ray-traced", "model"): ("ray-traced radio, told the paper's", VERMILION, "D"),
        ("ray-traced", "truth"): ("ray-traced radio, told the truth", GREEN, "^"),
    }
    flown = {radio: flown_over_places(radio) for radio in ("model", "ray-traced")}
    for above, ax, place in zip(*axes, places, strict=True):
        draw_city(above, City.load(RUNS.parent / "places" / f"{place}.png")).set(
            xticks=[], yticks=[], xlabel="", ylabel=""
        )
        above.set_title(place.replace("_", " ").title())
        _rows(ax, [""] * len(told))
        ax.axvline(0, color=INK, lw=0.8)
        ax.set_xlim(-1, 12)
        for row, ((radio, belief), kind) in enumerate(told.items()):
            here = flown[radio]["greedy"]["place"] == place
            ahead = flown[radio][belief]["return"] - flown[radio]["greedy"]["return"]
            found = bootstrap_interval(ahead[here])
            _interval(ax, row, found, kind, number(found.mean))
    axes[1, 0].set_xlabel("return ahead of greedy")
    _legend(figure, told.values())
    return figure


TRAINED = {  # runs of the chart of speed: study and variant
    "small: 144,000 steps in the village": ("centring-village", "centred"),
    "lite: 300,000 steps over Manhattan": ("pilots-manhattan", "centred_as_it_is"),
    "told: 1.5 million steps": ("failsafe-manhattan", "told"),
    "imitation: 2.6 million steps": ("imitation-manhattan", "imitation"),
    "any city: 1.6 million steps": ("any_city", "imitation"),
    "plain: a million steps": ("centring_plain-manhattan", "centred"),
}


def speed() -> Figure:
    """How long training runs took on one core, a dot for each."""
    figure = _figure(2.6)
    ax = figure.subplots()
    _rows(ax, list(TRAINED))
    for row, (study, variant) in enumerate(TRAINED.values()):
        about = json.loads((RUNS / f"{study}.json").read_text(encoding="utf-8"))
        runs = [run for name, run in about["runs"].items() if name.rpartition("-")[0] == variant]
        if "begun" in about:  # elsewhere, with other seeds than 0
            runs = [run for run in runs if run["seed"] == 0]
        _dots(ax, [run["seconds"] / 60 for run in runs], row, LEARNED["reward"])
    ax.set(xscale="log", xlabel="minutes on one core, beside other programs; a dot for each run")
    ticks = (1, 3, 10, 30, 100, 300)
    ax.set_xticks(ticks, map(str, ticks))
    ax.minorticks_off()
    return figure


LADDER = "ladder.csv.gz"
ABLATION = tuple(f"centring_{recipe}-manhattan.csv.gz" for recipe in ("plain", "lite"))
COMPARISONS = tuple(f"comparison-{name}.csv.gz" for name in (*MAPS, "harbour", "metropolis"))
CHARTS = {  # name: what draws it, and from which recorded files
    "ladder": (ladder, (LADDER,)),
    "ladder_small": (lambda: ladder(FEW, 6.6), (LADDER,)),
    "claims": (claims, (LADDER, *ABLATION)),
    "agents": (agents, (*COMPARISONS, "comparison-any_city.csv.gz")),
    "steps": (steps, (LADDER, ABLATION[0], "ddqn-manhattan.csv.gz")),
    "centring": (centring, ABLATION),
    "parts": (parts, ("pilots-manhattan.csv.gz", "short-manhattan.csv.gz")),
    "four_ways": (four_ways, ("four_ways-manhattan.csv.gz",)),
    "any_city": (any_city, ("comparison-any_city.csv.gz", "unseen_cities.csv.gz")),
    "real_city": (real_city, ("real_city.csv.gz",)),
    "speed": (speed, tuple(f"{study}.json" for study, _ in TRAINED.values())),
}


def source_of(name: str) -> str:
    """The recorded files of a chart, with their digest, as its file says."""
    files = CHARTS[name][1]
    digest = hashlib.sha256(b"".join((RUNS / file).read_bytes() for file in files))
    return f"{', '.join(files)}: {digest.hexdigest()[:16]}"


def save_chart(name: str, out: Path = OUT) -> Path:
    """Draw a chart and write its SVG, atomically, with the rule for dark pages."""
    with matplotlib.rc_context(STYLE):
        picture = io.StringIO()
        about = {"Date": None, "Creator": None, "Description": source_of(name)}
        CHARTS[name][0]().savefig(picture, format="svg", metadata=about)
    rules = "".join(
        f'[style*="{what}: {light}"]{{{what}:{dark}!important}}'
        for light, dark in DARK.items()
        for what in ("fill", "stroke")
    )
    rule = f"<style>@media (prefers-color-scheme:dark){{{rules}}}</style>\n <metadata>"
    text = picture.getvalue().replace("<metadata>", rule, 1)
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / f"{name}.svg", lambda file: file.write_text(text, encoding="utf-8"))
    return out / f"{name}.svg"

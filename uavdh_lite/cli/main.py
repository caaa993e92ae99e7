"""The command line: `python -m uavdh_lite --help`."""

import argparse
import json
import shlex
import sys
import typing
from dataclasses import MISSING, fields, replace
from pathlib import Path

from uavdh_lite.cli.arguments import positive
from uavdh_lite.cli.challenge import add_commands
from uavdh_lite.errors import InputError, TrainingDiverged
from uavdh_lite.paper import RESULTS
from uavdh_lite.recipe import Recipe, find_recipe
from uavdh_lite.scenario import Scenario, find_scenario
from uavdh_lite.storage import write_atomically
from uavdh_lite.streams import Use, stream


class _Parser(argparse.ArgumentParser):
    """A parser whose errors take one line."""

    def error(self, message: str) -> typing.NoReturn:
        self.exit(2, f"{self.prog}: error: {message}\n")


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit status.

    0; 1 for files or a training that diverged; 2 for bad input; 130 for Ctrl-C.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    options = _parser().parse_args(arguments)
    options.command_line = shlex.join(["python", "-m", "uavdh_lite", *arguments])
    try:
        options.run(options)
    except InputError as error:
        print(f"uavdh_lite: error: {error}", file=sys.stderr)
        return 2
    except (OSError, TrainingDiverged) as error:
        print(f"uavdh_lite: error: {error}", file=sys.stderr)
        return 1
    except MemoryError as error:
        print(f"uavdh_lite: error: not enough memory: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def _parser() -> _Parser:
    parser = _Parser("uavdh_lite", description="UAV data harvesting by deep reinforcement learning")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    demo = commands.add_parser("demo", help="evaluate the shipped agents and draw four flights")
    _common(demo, _demo, episodes=True, out="demo.png")

    train = commands.add_parser(
        "train",
        help="train an agent",
        description="Train an agent. Options of scenario and recipe replace single values of the "
        "named ones.",
    )
    train.add_argument("--scenario", default="manhattan", help="a preset's name (%(default)s)")
    train.add_argument("--recipe", default="lite", help="paper, lite or small (%(default)s)")
    train.add_argument("--out", help="folder of the run (runs/SCENARIO-RECIPE-SEED)")
    train.add_argument("--resume", action="store_true", help="go on with the run in that folder")
    train.add_argument(
        "--stop-after", type=positive, metavar="STEPS", help="leave the run after so many steps"
    )
    train.add_argument(
        "--threads",
        type=int,
        choices=(1, 2),
        default=2,
        help="2: one flies while the other learns, with the same result (%(default)s)",
    )
    train.add_argument(
        "--tensorboard", action="store_true", help="write event files for TensorBoard, too"
    )
    _common(train, _train, seed_help="seed of weights, episodes and exploration")
    _fields(train.add_argument_group("scenario"), Scenario)
    _fields(train.add_argument_group("recipe"), Recipe)

    ablation = commands.add_parser(
        "ablation",
        help="train with and without something, over several seeds",
        description="Train the variants of a study with several seeds, and draw their curves. "
        "Interrupted, the same command goes on. Options of the recipe hold for all variants.",
    )
    ablation.add_argument(
        "--study", default="centring", help="centring or deviations (%(default)s)"
    )
    ablation.add_argument(
        "--variants", nargs="+", metavar="NAME", help="run only these of the study (all)"
    )
    ablation.add_argument("--scenario", default="manhattan", help="a preset's name (%(default)s)")
    ablation.add_argument("--recipe", default="lite", help="paper, lite or small (%(default)s)")
    ablation.add_argument("--seeds", type=positive, default=3, help="runs a variant (%(default)s)")
    ablation.add_argument("--jobs", type=positive, default=1, help="runs at a time (%(default)s)")
    ablation.add_argument("--backend", default="loky", help="loky or dask (%(default)s)")
    ablation.add_argument("--scheduler", metavar="ADDRESS", help="of a Dask cluster (a local one)")
    ablation.add_argument("--out", help="folder of the runs (runs/STUDY-SCENARIO-RECIPE)")
    ablation.set_defaults(run=_ablation)
    _fields(ablation.add_argument_group("recipe"), Recipe)

    evaluate = commands.add_parser("evaluate", help="fly an agent over many random scenarios")
    _checkpoint(evaluate, required=True)
    evaluate.add_argument("--json", metavar="FILE", help="write mean, low and high of each metric")
    _common(evaluate, _evaluate, episodes=True)

    compare = commands.add_parser(
        "compare",
        help="an agent beside the planners on the same scenarios",
        description="Fly an agent, the random and the greedy planner and the genie over the same "
        "scenarios with the same fading, and write the metrics of every episode as a table.",
    )
    _checkpoint(compare, required=False)
    compare.add_argument("--jobs", type=positive, default=1, help="processes (%(default)s)")
    compare.add_argument(
        "--replan",
        type=positive,
        default=5,
        help="steps after which the genie plans anew (%(default)s); fewer take longer",
    )
    _common(compare, _compare, episodes=True)
    compare.add_argument("--out", help="the table (comparison-SCENARIO.csv.gz), JSON beside it")

    fly = commands.add_parser(
        "fly",
        help="fly one scenario of your own and draw it",
        description="Fly one scenario and draw it. What is not given is drawn at random.",
    )
    _checkpoint(fly, required=False)
    fly.add_argument("--devices", nargs="+", type=_cell, metavar="ROW,COL", help="device cells")
    fly.add_argument("--data", nargs="+", type=float, metavar="UNITS", help="data of each device")
    fly.add_argument("--flying-time", type=int, metavar="N", help="units of time")
    fly.add_argument("--mission", metavar="FILE", help="fly the mission of this file instead")
    fly.add_argument("--save-mission", metavar="FILE", help="write the mission to a file, to share")
    fly.add_argument("--start", type=_cell, metavar="ROW,COL", help="the UAV's first cell")
    _common(fly, _fly, out="flight.png", seed_help="seed of the fading and of what is not given")

    export = commands.add_parser(
        "export",
        help="an agent's network as an ONNX file",
        description="Write an agent's network as an ONNX file, once it is checked that ONNX "
        "Runtime decides as the agent does.",
    )
    _checkpoint(export, required=True)
    export.add_argument("--out", default="agent.onnx", help="the file (%(default)s)")
    export.set_defaults(run=_export, device="cpu")

    add_commands(commands)

    app = commands.add_parser(
        "app",
        help="the interactive labs as a web page on this machine",
        description="Serve the interactive labs on 127.0.0.1 with Voilà, until Ctrl-C.",
    )
    app.add_argument(
        "--port", type=positive, default=8866, help="the next free one if taken (%(default)s)"
    )
    app.add_argument(
        "--sessions",
        type=positive,
        default=8,
        help="people at a time, each with a process of about 350 MB (%(default)s)",
    )
    app.add_argument(
        "--idle-seconds",
        type=positive,
        default=1200,
        help="a session unused for so long is ended (%(default)s)",
    )
    app.add_argument(
        "--browser",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="open the page in a browser",
    )
    app.set_defaults(run=_app)

    city = commands.add_parser("city", help="check a city's PNG and draw it")
    city.add_argument("path", help="a PNG, or the name of a shipped city")
    city.add_argument("--out", default="city.png", help="the figure (%(default)s)")
    city.set_defaults(run=_city)
    return parser


def _common(parser, run, episodes=False, out=None, seed_help="seed of scenarios and fading"):
    """Options that several commands share."""
    parser.set_defaults(run=run)
    parser.add_argument("--seed", type=_natural, default=0, help=f"{seed_help} (%(default)s)")
    parser.add_argument("--device", default="cpu", help="cpu or cuda (%(default)s)")
    if episodes:
        parser.add_argument(
            "--episodes", type=positive, default=1000, help="random scenarios (%(default)s)"
        )
    if out:
        parser.add_argument("--out", default=out, help="the figure (%(default)s)")


def _checkpoint(parser, required: bool) -> None:
    parser.add_argument(
        "--checkpoint",
        required=required,
        default=None if required else "manhattan",
        metavar="PATH",
        help="a checkpoint file, or the name of a shipped agent"
        + ("" if required else " (%(default)s)"),
    )
    parser.add_argument("--city", metavar="PATH", help="another city of the same size")


def _fields(group, config: type) -> None:
    """An option for each field of a dataclass that carries a help text."""
    types = typing.get_type_hints(config)
    for field in fields(config):
        if "help" not in field.metadata:
            continue
        kind = types[field.name]
        default = field.default if field.default is not MISSING else ""
        if isinstance(default, tuple):
            default = " ".join(map(str, default))
        option = {"help": f"{field.metadata['help']} [{default}]", "default": argparse.SUPPRESS}
        if kind is bool:
            option["action"] = argparse.BooleanOptionalAction
        elif typing.get_origin(kind) is tuple:
            inner = typing.get_args(kind)
            option |= {"type": inner[0], "nargs": "+" if inner[-1] is Ellipsis else len(inner)}
            option["metavar"] = "N"
        else:
            option["type"] = kind if kind in (int, float, str) else _float_or_none
            option["metavar"] = "N"
        group.add_argument("--" + field.name.replace("_", "-"), **option)


def _given(options: argparse.Namespace, config: type) -> dict:
    """The fields of a dataclass for which an option was given."""
    given = vars(options)
    values = {
        field.name: given[field.name]
        for field in fields(config)
        if "help" in field.metadata and field.name in given
    }
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}


def _cell(text: str) -> tuple[int, int]:
    try:
        row, col = text.split(",")
        return int(row), int(col)
    except ValueError:
        message = f"{text!r} is not a cell: write ROW,COL as in 3,12"
        raise argparse.ArgumentTypeError(message) from None


def _natural(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 0")
    return int(text)


def _float_or_none(text: str) -> float | None:
    return None if text == "none" else float(text)


def _device(name: str) -> str:
    import torch

    if name not in ("cpu", "cuda"):
        raise InputError(f"unknown device {name!r}: choose cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError("no CUDA device: leave out --device, or install a CUDA build of torch")
    return name


def _train(options: argparse.Namespace) -> None:
    import torch

    from uavdh_lite.experiments.runs import train
    from uavdh_lite.training import OverlappedTrainer, Trainer

    scenario = replace(find_scenario(options.scenario), **_given(options, Scenario))
    recipe = replace(find_recipe(options.recipe), **_given(options, Recipe))
    out = options.out or f"runs/{scenario.name}-{recipe.name}-{options.seed}"
    torch.set_num_threads(1)
    device = _device(options.device)
    kind = OverlappedTrainer if options.threads == 2 else Trainer
    trainer = kind(scenario, recipe, options.seed, device=device)
    best = train(
        trainer,
        out,
        options.resume,
        options.command_line,
        stop_after=options.stop_after,
        tensorboard=options.tensorboard,
    )
    if not best.exists():
        return  # left before the first validation
    print(f"best agent: {best}\nto see it: python -m uavdh_lite evaluate --checkpoint {best}")


def _ablation(options: argparse.Namespace) -> None:
    from matplotlib.figure import Figure

    from uavdh_lite.experiments.ablation import STUDIES, collect_curves, run_study
    from uavdh_lite.plotting import draw_study, save_figure
    from uavdh_lite.storage import read_table

    if options.study not in STUDIES:
        raise InputError(f"unknown study {options.study!r}: choose one of {', '.join(STUDIES)}")
    scenario = find_scenario(options.scenario)
    recipe = replace(find_recipe(options.recipe), **_given(options, Recipe))
    out = Path(options.out or f"runs/{options.study}-{scenario.name}-{recipe.name}")
    variants = STUDIES[options.study](recipe)
    for name in options.variants or ():
        if name not in variants:
            raise InputError(f"unknown variant {name!r}: choose from {', '.join(variants)}")
    folders = run_study(
        scenario,
        {name: variants[name] for name in options.variants or variants},
        options.seeds,
        out,
        options.jobs,
        options.backend,
        options.scheduler,
        options.command_line,
    )
    training, validation = collect_curves(folders, out, options.command_line)
    print("collection ratio and landed at the end, validation scenarios, by seed:")
    table = read_table(validation)
    last = table["steps"] == table["steps"].max()
    for name in folders:
        ends = table["collection_ratio_and_landed"][last & (table["variant"] == name)]
        print(f"{name:<28}" + "".join(f"{end:>9.4f}" for end in ends))
    figure = Figure(figsize=(9, 4), layout="constrained")
    draw_study(figure, read_table(training))
    save_figure(figure, out / "curves.png")
    print(out / "curves.png")


def _evaluate(options: argparse.Namespace) -> None:
    from uavdh_lite.environment import Environment
    from uavdh_lite.evaluation import evaluate

    agent = _agent(options)
    flights = evaluate(
        Environment(agent.city), agent, agent.scenario, options.episodes, options.seed
    )
    metrics = flights.metrics()
    print(f"{agent.scenario.name}: {options.episodes} random scenarios, seed {options.seed}")
    print(f"{'':<28}{'mean':>9}{'95 % interval':>22}")
    for name, interval in metrics.items():
        print(f"{name:<28}{interval.mean:>9.4f}{f'{interval.low:.4f} to {interval.high:.4f}':>22}")
    if options.json:
        values = {name: interval._asdict() for name, interval in metrics.items()}
        text = json.dumps(values, indent=2)
        write_atomically(options.json, lambda temporary: temporary.write_text(text + "\n"))


def _compare(options: argparse.Namespace) -> None:
    import time

    from uavdh_lite.environment import Environment
    from uavdh_lite.evaluation import mean_interval
    from uavdh_lite.experiments.comparison import breakdown, compare, share
    from uavdh_lite.planners import Genie, Greedy, Random
    from uavdh_lite.provenance import provenance
    from uavdh_lite.storage import write_json, write_table

    agent = _agent(options)
    environment = Environment(agent.city)
    started = time.perf_counter()
    results = compare(
        environment,
        agent.scenario,
        {
            "agent": lambda: agent,
            "random": lambda: Random(options.seed),
            "greedy": lambda: Greedy(environment),
            "genie": lambda: Genie(environment, replan=options.replan),
            "genie_data": lambda: Genie(environment, replan=options.replan, time_cost=0.01),
        },
        options.episodes,
        options.seed,
        options.jobs,
    )
    out = Path(options.out or f"comparison-{agent.scenario.name}.csv.gz")
    write_table(
        out,
        [
            {"policy": policy, "episode": episode} | {k: v[episode].item() for k, v in each.items()}
            for policy, each in results.items()
            for episode in range(options.episodes)
        ],
    )
    about = {
        "command": options.command_line,
        "seed": options.seed,
        "seconds": round(time.perf_counter() - started, 1),
        "jobs": options.jobs,
        **provenance(),
        "agent": agent.training,
    }
    write_json(out.with_name(out.name.split(".")[0] + ".json"), about)

    print(f"{agent.scenario.name}: {options.episodes} random scenarios, seed {options.seed}")
    names = ("has_landed", "collection_ratio", "collection_ratio_and_landed", "cumulative_reward")
    print(f"{'':<12}" + "".join(f"{name:>30}" for name in names))
    for policy, each in results.items():
        means = [mean_interval(each[name]) for name in names]
        print(f"{policy:<12}" + "".join(f"{_interval(mean):>30}" for mean in means))
    for metric, reference in (
        ("collection_ratio_and_landed", "genie_data"),
        ("cumulative_reward", "genie"),
    ):
        part = share(results["agent"][metric], results[reference][metric])
        print(f"agent's {metric} as a share of the {reference}'s: {_interval(part)}")
    print("collection ratio and landed of the agent and the genie_data, by what was drawn:")
    metric = "collection_ratio_and_landed"
    for by in ("devices", "flying_time", "data"):
        groups = [
            breakdown(results[policy][metric], results[policy][by])
            for policy in ("agent", "genie_data")
        ]
        for (label, count, ours), (_, _, theirs) in zip(*groups, strict=True):
            print(f"{by:<12}{label:>18}{count:>6}{_interval(ours):>30}{_interval(theirs):>30}")
    print(out)


def _interval(interval) -> str:
    mean, low, high = interval
    return f"{mean:.4f} ({low:.4f} to {high:.4f})"


def _agent(options: argparse.Namespace):
    from uavdh_lite.checkpoint import load_agent
    from uavdh_lite.city import City

    agent = load_agent(options.checkpoint, _device(options.device))
    return agent if options.city is None else agent.over(City.load(options.city))


def _demo(options: argparse.Namespace) -> None:
    from matplotlib.figure import Figure

    from uavdh_lite.checkpoint import load_agent, shipped_agents
    from uavdh_lite.environment import Environment
    from uavdh_lite.evaluation import evaluate
    from uavdh_lite.plotting import add_legend, draw_trajectory, save_figure

    names = [name for name in RESULTS if name in shipped_agents()]
    drawn = []
    for name in names:
        agent = load_agent(name, _device(options.device))
        environment = Environment(agent.city)
        flights = evaluate(
            environment, agent, agent.scenario, options.episodes, options.seed, record=True
        )
        metrics = flights.metrics()
        print(f"{name}: {options.episodes} random scenarios, seed {options.seed}")
        print(f"{'':<28}{'this agent':>12}{'95 % interval':>20}{'paper':>10}")
        for metric, paper in RESULTS[name].items():
            mean, low, high = metrics[metric]
            between = f"{low:.1%} to {high:.1%}"
            print(f"{metric.replace('_', ' '):<28}{mean:>12.1%}{between:>20}{paper:>10.1%}")
        print(f"{'flying time used':<28}{metrics['time_used'].mean:>12.1%}\n")
        count = min(4 // len(names), options.episodes)
        drawn += [(environment, flights, episode) for episode in range(count)]

    figure = Figure(figsize=(11, 13), layout="constrained")
    for place, (environment, flights, episode) in enumerate(drawn, start=1):
        ax = figure.add_subplot(2, 2, place)
        draw_trajectory(ax, environment, flights.trajectory(episode))
        ax.set_title(f"{environment.city.name}, scenario {episode}")
    add_legend(figure, max(flights.start.device_cells.shape[1] for _, flights, _ in drawn))
    save_figure(figure, options.out)
    print(f"The first {len(drawn)} flights are drawn in {options.out}.")
    print("The maps are redrawn from the paper's text, its own were never published: the agents")
    print("solve the same task, but not on the same streets.")


def _fly(options: argparse.Namespace) -> None:
    from matplotlib.figure import Figure

    from uavdh_lite.environment import Environment
    from uavdh_lite.missions import Mission, load_mission, save_mission
    from uavdh_lite.plotting import add_legend, caption, draw_trajectory, save_figure

    agent = _agent(options)
    if options.mission:
        mission = load_mission(options.mission)
        agent = agent.over(mission.city)
    else:
        mission = Mission.draw(agent.scenario, agent.city, options.seed)
        devices = tuple(options.devices or mission.devices)
        data = tuple(options.data or _data_for(devices, mission, agent.scenario, options.seed))
        mission = replace(
            mission,
            start=options.start or mission.start,
            devices=devices,
            data=data,
            flying_time=(
                mission.flying_time if options.flying_time is None else options.flying_time
            ),
        )
    if options.save_mission:
        save_mission(options.save_mission, mission)
    environment = Environment(mission.city)
    trajectory = mission.fly(environment, agent).trajectory(0)

    figure = Figure(figsize=(7, 9), layout="constrained")
    draw_trajectory(figure.subplots(), environment, trajectory)
    add_legend(figure, len(mission.devices))
    save_figure(figure, options.out)
    print(f"{'landed' if trajectory.landed else 'crashed'}. {caption(trajectory)}. {options.out}")


def _data_for(devices, mission, scenario: Scenario, seed: int) -> list[float]:
    """The mission's own data, or random amounts if there are not as many devices."""
    if len(devices) == len(mission.data):
        return list(mission.data)
    generator = stream(Use.MISSION, seed)
    return generator.uniform(*scenario.data, len(devices)).round(1).tolist()


def _export(options: argparse.Namespace) -> None:
    from uavdh_lite.export import export_onnx

    error = export_onnx(_agent(options), options.out)
    print(f"{options.out}: decides as the agent; Q-values differ by at most {error:.1g}")


def _app(options: argparse.Namespace) -> None:
    try:
        from uavdh_lite.labs.app.server import serve
    except ModuleNotFoundError as error:
        if error.name.split(".")[0] not in ("voila", "tornado"):
            raise
        raise InputError("Voilà is not installed: pip install 'uavdh-lite[app]'") from None
    serve(options.port, options.sessions, options.idle_seconds, options.browser)


def _city(options: argparse.Namespace) -> None:
    from matplotlib.figure import Figure

    from uavdh_lite.city import City
    from uavdh_lite.plotting import draw_city, save_figure

    city = City.load(options.path)
    farthest = city.landing_distance.max()
    unreachable = int(((city.landing_distance < 0) & ~city.no_fly).sum())
    print(f"{city.name}: {city.size} × {city.size} cells, valid")
    print(f"{len(city.landing_cells)} landing cells, {len(city.flight_cells)} cells to fly over")
    print(f"{len(city.device_cells)} cells for devices")
    print(
        f"at most {farthest} moves to a landing cell; {unreachable} flight cells have no way to one"
    )
    figure = Figure(figsize=(7, 7), layout="constrained")
    draw_city(figure.subplots(), city)
    save_figure(figure, options.out)
    print(Path(options.out))


if __name__ == "__main__":
    sys.exit(main())

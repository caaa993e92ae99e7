"""`train` and `study`: the commands with the options of a scenario and a recipe."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import joblib
import torch
from cyclopts import Parameter
from cyclopts.types import NonNegativeInt, PositiveInt
from cyclopts.validators import Number
from matplotlib.figure import Figure

from uavdh_lite.cli.options import CommandLine, Count, Flag, options_of, presets, with_values
from uavdh_lite.errors import InputError
from uavdh_lite.experiments import runs
from uavdh_lite.experiments import study as studies
from uavdh_lite.experiments.report import table
from uavdh_lite.plotting import draw_study, save_figure
from uavdh_lite.storage import read_table
from uavdh_lite.training import trainer_of

THREADS = min(2, joblib.cpu_count())


def train(arguments: list[str]) -> Callable[..., None]:
    """The command with the options of the scenario and the recipe that the arguments name."""
    named_scenario, named_recipe = presets(arguments)
    scenario_options = options_of(named_scenario, "Scenario")
    channel_options = options_of(named_scenario.channel, "Channel")
    recipe_options = options_of(named_recipe, "Recipe")

    def train(
        *,
        scenario: str = named_scenario.name,
        recipe: str = named_recipe.name,
        seed: NonNegativeInt = 0,
        out: Path | None = None,
        resume: Flag = False,
        stop_after: PositiveInt | None = None,
        threads: Annotated[int, Parameter(validator=Number(gte=1, lte=1024))] = THREADS,
        device: Literal["cpu", "cuda", "mps"] = "cpu",
        tensorboard: Flag = False,
        scenario_values: scenario_options = None,  # type: ignore[valid-type]
        channel_values: channel_options = None,  # type: ignore[valid-type]
        recipe_values: recipe_options = None,  # type: ignore[valid-type]
        command_line: CommandLine,
    ) -> None:
        """Train an agent.

        The options under Scenario, Channel and Recipe replace single values of the scenario, its
        radio channel and the recipe. The defaults below are those of the scenario and the recipe
        that you name.

        Arguments:
            scenario: what to train for: manhattan, open_field, village, harbour, metropolis, or
                any_city, 3000 random cities.
            recipe: how to train: lite, plain, paper, small, told or imitation.
            seed: seed of the weights, the episodes and the exploration.
            out: folder of the run, by default runs/SCENARIO-RECIPE-SEED.
            resume: continue the run in that folder; if nothing is saved there yet, begin it.
            stop_after: stop after this many environment steps; --resume continues.
            threads: of PyTorch, by default two, or one where it has a single processor; another
                number gives another agent of the same kind, so a run continues only with its own.
            device: what the network runs on.
            tensorboard: write event files for TensorBoard as well.
        """
        if device != "cpu" and not getattr(torch, device).is_available():
            raise InputError(f"no {device} device for this torch: leave out --device")
        torch.set_num_threads(threads)
        out = out or Path("runs", f"{scenario}-{recipe}-{seed}")
        changed_scenario = replace(
            with_values(named_scenario, scenario_values),
            channel=with_values(named_scenario.channel, channel_values),
        )
        changed_recipe = with_values(named_recipe, recipe_values)
        trainer = trainer_of(changed_recipe)(changed_scenario, changed_recipe, seed, device=device)
        best = runs.train(
            trainer, out, resume, command_line, stop_after=stop_after, tensorboard=tensorboard
        )
        if best.exists():
            print(f"best agent: {best}")
            print(f"to see it: python -m uavdh_lite evaluate --checkpoint {best}")
        else:
            print(f"no {best}: it is written at a validation, and none came since the start")

    return train


def study(arguments: list[str]) -> Callable[..., None]:
    """The command with the options of the recipe that the arguments name."""
    named_scenario, named_recipe = presets(arguments)
    channel_options = options_of(named_scenario.channel, "Channel")
    recipe_options = options_of(named_recipe, "Recipe")

    def study(
        *,
        variants: Annotated[tuple[str, ...], Parameter(metavar="FIELD=VALUE...")] = (),
        scenario: str = named_scenario.name,
        recipe: str = named_recipe.name,
        seeds: Count = 3,
        jobs: PositiveInt = 1,
        cluster: str = "",
        out: Path = Path("runs", "study"),
        channel_values: channel_options = None,  # type: ignore[valid-type]
        recipe_values: recipe_options = None,  # type: ignore[valid-type]
        command_line: CommandLine,
    ) -> None:
        """Train several variants of a recipe, over several seeds.

        Each variant is trained with several seeds, and their curves are drawn. If you stop the
        command, run it again: it continues. The options under Channel and Recipe hold for all
        variants; their defaults below are those of the scenario and the recipe that you name.

        Arguments:
            variants: changes of the recipe, such as as_it_is leak=0 strides=[3,1],kernels=8; by
                default the paper's, observation=centred and observation=non_centred.
            scenario: what to train for, as in train.
            recipe: how to train, as in train.
            seeds: number of runs of each variant, with the seeds 0, 1, and so on.
            jobs: number of runs at a time.
            cluster: address of a Dask scheduler, whose workers make the runs.
            out: folder of the runs.
        """
        changed = with_values(named_recipe, recipe_values)
        trained = studies.variants_of(changed, variants) if variants else studies.centring(changed)
        channel = with_values(named_scenario.channel, channel_values)
        changed_scenario = replace(named_scenario, channel=channel)
        studies.require_fit(changed_scenario, trained)
        jobs = min(jobs, seeds * len(trained))
        folders = studies.run_study(
            changed_scenario, trained, seeds, out, jobs, command_line, cluster
        )
        training, validation = studies.collect_curves(folders, out, command_line)
        print("collected and landed at the end, validation missions, by seed:")
        scores = studies.final_scores(validation)
        print(table([name, *(f"{score:.4f}" for score in row)] for name, row in scores.items()))
        figure = Figure(figsize=(9, 4), layout="constrained")
        draw_study(figure, read_table(training))
        save_figure(figure, out / "curves.png")
        print(out / "curves.png")

    return study

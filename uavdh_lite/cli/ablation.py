"""`ablation`: train with and without a part of the method."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from cyclopts.types import PositiveInt

from uavdh_lite.cli.overrides import Arguments, named_presets, options_of, with_values
from uavdh_lite.cli.parsing import CommandLine, application, run

if TYPE_CHECKING:
    from uavdh_lite.recipe import Recipe
    from uavdh_lite.scenario import Scenario


def ablation(*arguments: Arguments, command_line: CommandLine) -> None:
    """Train with and without a part of the method, over several seeds."""
    app = application(_ablation(*named_presets(arguments)))
    run(app, ["ablation", *arguments], command_line)


def _ablation(named_scenario: "Scenario", named_recipe: "Recipe") -> Callable[..., None]:
    """The command, with the values of this recipe as its defaults."""
    recipe_options = options_of(named_recipe, "Recipe")

    def ablation(
        *,
        study: str = "centring",
        variants: Annotated[tuple[str, ...], Parameter(show_default=False)] = (),
        scenario: str = "manhattan",
        recipe: str = "lite",
        seeds: PositiveInt = 3,
        jobs: PositiveInt = 1,
        backend: Literal["loky", "dask"] = "loky",
        scheduler: str | None = None,
        out: Path | None = None,
        recipe_values: recipe_options = None,  # type: ignore[valid-type]
        command_line: CommandLine,
    ) -> None:
        """Train with and without a part of the method, over several seeds.

        The variants of a study are trained with several seeds each, and their curves are drawn. If
        you stop the command, run it again: it continues. The options under Recipe hold for all
        variants; their defaults below are those of the recipe that you name.

        Arguments:
            study: what is left out or changed: centring, deviations, parts or values.
            variants: names of the study's variants to run, by default all.
            scenario: what to train for: manhattan, open_field, village, harbour, metropolis,
                any_city (2000 random cities) or any_size (1000 of 8 to 50 cells a side).
            recipe: how to train: lite, paper, small, quantile or fine_tune.
            seeds: number of runs of each variant, with the seeds 0, 1, and so on.
            jobs: number of runs at a time.
            backend: where they run: loky, on this machine; dask, on the workers of a Dask cluster.
            scheduler: address of a Dask cluster, such as tcp://node1:8786; else one starts here.
            out: folder of the runs, by default runs/STUDY-SCENARIO-RECIPE.
        """
        from matplotlib.figure import Figure

        from uavdh_lite.experiments.ablation import (
            collect_curves,
            final_scores,
            find_study,
            run_study,
        )
        from uavdh_lite.plotting import draw_study, save_figure
        from uavdh_lite.storage import read_table

        trained = find_study(study, with_values(named_recipe, recipe_values), variants)
        out = out or Path("runs", f"{study}-{scenario}-{recipe}")
        folders = run_study(
            named_scenario, trained, seeds, out, jobs, backend, scheduler, command_line
        )
        training, validation = collect_curves(folders, out, command_line)
        print("collection ratio and landed at the end, validation missions, by seed:")
        for name, scores in final_scores(validation).items():
            print(f"{name:<28}" + "".join(f"{score:>9.4f}" for score in scores))
        figure = Figure(figsize=(9, 4), layout="constrained")
        draw_study(figure, read_table(training))
        save_figure(figure, out / "curves.png")
        print(out / "curves.png")

    return ablation

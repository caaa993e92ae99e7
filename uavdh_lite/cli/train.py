"""`train`: train an agent."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from cyclopts.types import NonNegativeInt, PositiveInt

from uavdh_lite.cli.arguments import Device, Flag, require_device
from uavdh_lite.cli.overrides import Arguments, BeginWith, named_presets, options_of, with_values
from uavdh_lite.cli.parsing import CommandLine, application, run

if TYPE_CHECKING:
    from uavdh_lite.recipe import Recipe
    from uavdh_lite.scenario import Scenario


def train(*arguments: Arguments, command_line: CommandLine) -> None:
    """Train an agent."""
    app = application(_train(*named_presets(arguments)))
    run(app, ["train", *arguments], command_line)


def _train(named_scenario: "Scenario", named_recipe: "Recipe") -> Callable[..., None]:
    """The command, with the values of these as its defaults."""
    scenario_options = options_of(named_scenario, "Scenario")
    recipe_options = options_of(named_recipe, "Recipe")

    def train(
        *,
        scenario: str = named_scenario.name,
        recipe: str = named_recipe.name,
        begin_with: BeginWith = None,
        seed: NonNegativeInt = 0,
        out: Path | None = None,
        resume: Flag = False,
        stop_after: PositiveInt | None = None,
        threads: Literal[1, 2] = 2,
        device: Device = "cpu",
        tensorboard: Flag = False,
        scenario_values: scenario_options = None,  # type: ignore[valid-type]
        recipe_values: recipe_options = None,  # type: ignore[valid-type]
        command_line: CommandLine,
    ) -> None:
        """Train an agent.

        The options under Scenario and Recipe replace single values of the scenario and the recipe
        that you name. The defaults below are those of that scenario and that recipe.

        Arguments:
            scenario: what to train for: manhattan, open_field, village, harbour, metropolis,
                any_city (2000 random cities) or any_size (1000 of 8 to 50 cells a side).
            recipe: how to train: lite, paper, small, quantile or fine_tune.
            begin_with: an agent to go on from, a checkpoint file or the name of a shipped one. Then
                the defaults are --scenario any_city and --recipe fine_tune.
            seed: seed of the weights, the episodes and the exploration.
            out: folder of the run, by default runs/SCENARIO-RECIPE-SEED.
            resume: continue the run in that folder.
            stop_after: stop after this many environment steps; --resume continues.
            threads: with 2, one flies while the other learns; the result is the same.
            device: what the network runs on.
            tensorboard: write event files for TensorBoard as well.
        """
        import torch

        from uavdh_lite.checkpoint import load_agent
        from uavdh_lite.experiments import runs
        from uavdh_lite.training import OverlappedTrainer, Trainer

        torch.set_num_threads(1)
        trainer = (OverlappedTrainer if threads == 2 else Trainer)(
            with_values(named_scenario, scenario_values),
            with_values(named_recipe, recipe_values),
            seed,
            device=require_device(device),
            begin_with=None if begin_with is None else load_agent(begin_with),
        )
        best = runs.train(
            trainer,
            out or Path("runs", f"{scenario}-{recipe}-{seed}"),
            resume,
            command_line,
            stop_after=stop_after,
            tensorboard=tensorboard,
        )
        if best.exists():  # not if the run was stopped before its first validation
            print(f"best agent: {best}")
            print(f"to see it: python -m uavdh_lite evaluate --checkpoint {best}")

    return train
